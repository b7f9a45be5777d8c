function z = normalize_all_bearings(z)
  % Wrap each second number of a vector range, bearing, range, bearing, ...
  z(2:2:end) = normalize_angle(z(2:2:end));
end
