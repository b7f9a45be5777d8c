% Run prediction_step.m and correction_step.m, the two functions of the Octave course's EKF-SLAM, on a recording.
%
%   octave-cli driver.m RECORDING ESTIMATE
%
% RECORDING is a folder with start.csv, odometry.csv and observations.csv (`slamgauge export csv` writes it, too).
% ESTIMATE is the CSV file of poses and covariances to write; landmarks.csv goes into its folder. Units: m, rad.
%
% The two functions are in the folder of this file. They receive
%   mu (3+2N, 1)              x, y, heading, then x and y of each landmark; landmark j is at mu(2*j+2 : 2*j+3)
%   sigma (3+2N, 3+2N)        its covariance; variances of landmarks begin at 1000 m^2
%   u                         fields r1 [rad], t [m], r2 [rad]: turn, drive, turn
%   z (1, m)                  struct array with the fields id (1..N), range [m], bearing [rad]
%                             (both have a field cov that the course lacks: the covariance of the increment dx, dy, dtheta
%                             in the body frame, and of range and bearing)
%   observedLandmarks (1, N)  true for each landmark that was observed before

1;  % a script file, because its first statement is not a function

function run_all(recording, estimate)
  start = dlmread(fullfile(recording, "start.csv"), ",", 1, 0);
  moves = dlmread(fullfile(recording, "odometry.csv"), ",", 1, 0);
  seen = dlmread(fullfile(recording, "observations.csv"), ",", 1, 0);
  require_ranges_and_ids(fullfile(recording, "observations.csv"), seen);
  if isempty(seen)
    seen = zeros(0, 7);
  end
  [ids, ~, numbers] = unique(seen(:, 2));
  N = numel(ids);
  mu = [start(2:4)'; zeros(2 * N, 1)];
  sigma = 1000 * eye(3 + 2 * N);
  sigma(1:3, 1:3) = symmetric(start(5:10));
  observedLandmarks = false(1, N);
  mapped = false(1, N);
  poses = zeros(rows(moves) + 1, 10);
  for step = 0:rows(moves)
    if step > 0
      [mu, sigma] = prediction_step(mu, sigma, turns_of(moves(step, 3:11)));
    end
    now = find(seen(:, 1) == step)';
    if ! isempty(now)
      z = observations_of(numbers(now), seen(now, 3:7));
      [mu, sigma, observedLandmarks] = correction_step(mu, sigma, z, observedLandmarks);
      mapped(numbers(now)) = true;
    end
    poses(step + 1, :) = [step, mu(1:3)', sigma(1, 1:3), sigma(2, 2:3), sigma(3, 3)];
  end
  write_table(estimate, "step,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt", poses);
  places = zeros(0, 6);
  for j = find(mapped)
    at = 2 * j + 2;
    places(end + 1, :) = [ids(j), mu(at:at + 1)', sigma(at, at:at + 1), sigma(at + 1, at + 1)];
  end
  write_table(fullfile(fileparts(estimate), "landmarks.csv"), "landmark,x,y,cov_xx,cov_xy,cov_yy", places);
end

function require_ranges_and_ids(path, seen)
  file = fopen(path);
  header = strtrim(fgetl(file));
  fclose(file);
  if ! strncmp(header, "step,landmark,range,bearing", 27) || (! isempty(seen) && any(seen(:, 2) < 0))
    error("the course's functions need ranges, bearings and ids; give a recording that has them");
  end
end

function z = observations_of(numbers, values)
  for k = numel(numbers):-1:1
    z(k) = struct("id", numbers(k), "range", values(k, 1), "bearing", values(k, 2), "cov", values(k, 3:5)([1, 2; 2, 3]));
  end
end

function u = turns_of(increment)
  % The body-frame increment dx, dy [m], dtheta [rad] as a turn, a distance and a turn; backwards the distance is negative.
  ahead = 1 - 2 * (increment(1) < 0);
  u.r1 = atan2(ahead * increment(2), ahead * increment(1));
  u.t = ahead * hypot(increment(1), increment(2));
  u.r2 = normalize_angle(increment(3) - u.r1);
  u.cov = symmetric(increment(4:9));
end

function cov = symmetric(triangle)
  % The covariance (3, 3) with this upper triangle, row by row.
  cov = triangle([1, 2, 3; 2, 4, 5; 3, 5, 6]);
end

function write_table(path, header, numbers)
  file = fopen(path, "w");
  fprintf(file, "%s\n", header);
  form = [repmat(",%.17g", 1, columns(numbers))(2:end), "\n"];
  if ! isempty(numbers)
    fprintf(file, form, numbers');
  end
  fclose(file);
end

here = fileparts(mfilename("fullpath"));
warning("off", "all");  % tools/pause.m replaces a function of Octave
addpath(here);
addpath(fullfile(here, "tools"), "-end");  % the course's helpers, if the folder has none of its own
given = argv();
try
  run_all(given{end - 1}, given{end});
catch problem
  where = problem.stack(1);
  fprintf(stderr, "%s (%s, line %d)\n", strrep(problem.message, "\n", " "), where.name, where.line);
  exit(1);
end
