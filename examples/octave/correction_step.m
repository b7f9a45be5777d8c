function [mu, sigma, observedLandmarks] = correction_step(mu, sigma, z, observedLandmarks)
  % Update with all observations of a step; the sensor noise is 0.01 for range [m^2] and bearing [rad^2].
  count = numel(z);
  H = zeros(2 * count, numel(mu));
  innovation = zeros(2 * count, 1);
  for k = 1:count
    at = 2 * z(k).id + 2;  % mu(at) and mu(at + 1) are the landmark's x and y
    if ! observedLandmarks(z(k).id)
      direction = mu(3) + z(k).bearing;
      mu(at:at + 1) = mu(1:2) + z(k).range * [cos(direction); sin(direction)];
      observedLandmarks(z(k).id) = true;
    end
    offset = mu(at:at + 1) - mu(1:2);
    q = offset' * offset;
    r = sqrt(q);
    rows = 2 * k - 1:2 * k;
    H(rows, 1:3) = [-offset(1) / r, -offset(2) / r, 0; offset(2) / q, -offset(1) / q, -1];
    H(rows, at:at + 1) = [offset(1) / r, offset(2) / r; -offset(2) / q, offset(1) / q];
    turn = normalize_angle(z(k).bearing - (atan2(offset(2), offset(1)) - mu(3)));
    innovation(rows) = [z(k).range - r; turn];
  end
  S = H * sigma * H' + 0.01 * eye(2 * count);
  K = sigma * H' / S;
  mu = mu + K * innovation;
  mu(3) = normalize_angle(mu(3));
  sigma = (eye(numel(mu)) - K * H) * sigma;
  sigma = (sigma + sigma') / 2;
end
