function angle = normalize_angle(angle)
  % Wrap angles [rad] of any shape to [-pi, pi).
  angle = mod(angle + pi, 2 * pi) - pi;
end
