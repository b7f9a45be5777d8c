function [mu, sigma] = prediction_step(mu, sigma, u)
  % Move the robot by u = (r1, t, r2); the motion noise of a step is diag(0.1, 0.1, 0.01) [m^2, m^2, rad^2].
  heading = mu(3) + u.r1;
  mu(1) = mu(1) + u.t * cos(heading);
  mu(2) = mu(2) + u.t * sin(heading);
  mu(3) = normalize_angle(heading + u.r2);

  F = eye(numel(mu));  % Jacobian by the state: landmarks stay where they are
  F(1, 3) = -u.t * sin(heading);
  F(2, 3) = u.t * cos(heading);
  sigma = F * sigma * F';
  sigma(1:3, 1:3) = sigma(1:3, 1:3) + diag([0.1, 0.1, 0.01]);
end
