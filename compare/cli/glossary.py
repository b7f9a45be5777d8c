"""Glossary: terms of tables, pages and verdicts; `docs/glossary.md` has the same rows, and those of the columns."""

TERMS = {
    "Measurements": {
        "recording": "Everything an estimator receives of a run: prior, odometry, observations and their covariances.",
        "truth": "The true poses, landmarks and associations of a run. Only scores use it.",
        "run": "One simulated recording with its truth, made from one seed.",
        "study": "Many runs of one scenario, with the same estimators on each.",
        "scenario": "The settings of a simulation: path, map, noise, sensor, association.",
        "step": "The time from one odometry measurement to the next. Step 0 is the start.",
        "increment": "The odometry of a step: displacement in the body frame and turn, (dx, dy, dθ).",
        "scan": "All observations of one step.",
        "observation": (
            "One measurement of one landmark: range and bearing, bearing only, or position in the body frame."
        ),
        "re-observed": "Observed again after an earlier observation.",
        "association": "The assignment of observations to landmarks. It is *known* if the recording has ids.",
        "loop closure": "A step at which a landmark is re-observed after at least 10 s.",
        "outlier": "An observation of a landmark with an error that its covariance does not explain.",
        "clutter": "An observation of no landmark.",
        "Q, R": "The covariance of an increment, and of an observation.",
        "prior": "Mean and covariance of the start pose.",
    },
    "Filters": {
        "state": "The robot's pose and the positions of all mapped landmarks.",
        "innovation": "Observation minus predicted observation, bearings wrapped to (-π, π].",
        "gate": "The largest squared Mahalanobis distance at which an observation is associated or accepted.",
        "correction": "The change of state and covariance by observations (update step).",
        "augmentation": "The addition of a new landmark to the state.",
        "first estimate": (
            "The first position of a landmark or prediction of a pose, where some filters take their Jacobians."
        ),
        "ray, member": (
            "A bearing-only landmark whose distance is unknown, as several Gaussians (members) along its bearing."
        ),
        "weight": "The probability of a member given the bearings so far.",
        "FIS": (
            "Federated information sharing: each member is corrected with its share of the measurement's information."
        ),
        "inverse depth": "A bearing-only landmark as an anchor, a direction and the inverse of its distance.",
        "delayed initialisation": "Waiting until several bearings triangulate a landmark.",
        "compressed update": (
            "An update of the robot's surroundings; the rest of the map is updated when the robot leaves."
        ),
        "sliding window": "The last poses as unknowns, linearised again at each scan.",
        "marginalise": "Remove a variable from a Gaussian and keep the distribution of the others.",
        "diverge": "Move away from the truth until innovations contradict the filter's own covariance.",
    },
    "The optimum": {
        "optimum": "The maximum a posteriori estimate: the minimum of the sum of squared weighted residuals.",
        "causal optimum": (
            "At each step the newest pose of the optimum of the measurements up to that step (`causal`)."
        ),
        "hindsight optimum": "The optimum of all measurements (`batch`).",
        "marginal": "The covariance of one variable, with all others marginalised.",
        "relinearise": "Take the Jacobians again at the present estimate.",
        "regularising noise": (
            "Small noise added where a variance is zero, so that a solver can invert the covariance."
        ),
        "Cramér-Rao bound": "The smallest covariance of any unbiased estimator for this model.",
    },
    "Scores": {
        "ATE": "Absolute trajectory error: RMS position error over a run, without alignment [m].",
        "NEES": "Normalised estimation error squared of the pose: its mean is 3 if the covariance is right.",
        "NIS": (
            "Normalised innovation squared: its mean is the number of observed values if innovations are as large as "
            "the filter expects. It does not show the inconsistency of SLAM."
        ),
        "chi2/dof, fit of the model": (
            "Weighted squared residuals of an optimum over degrees of freedom: about 1 if the stated noise is right."
        ),
        "NEES in 99.9% band": "Share of the steps whose mean NEES over runs is in the band of a right covariance.",
        "final sigma / optimum": (
            "The last sigma of x, y and heading over that of the optimum of the same kind: about 1 if both are right."
        ),
        "consistent": "The errors are as large as the covariance says.",
        "overconfident": "The errors are larger than the covariance says: NEES/3 is above 1.",
        "conservative": "The errors are smaller than the covariance says: NEES/3 is below 1.",
        "95 % ellipse": "The region that holds the true position with probability 0.95 if the covariance is right.",
        "filtered, smoothed": "From the measurements up to the step, and from all measurements.",
        "Mahalanobis distance": "The length of an error in standard deviations: its square is eᵀP⁻¹e.",
        "duplicate landmark": "A second landmark in the map for the same true landmark.",
        "error budget, budget": (
            "A filter's squared error split into the parts that optimum, noise, association and linearisation cause."
        ),
        "rung": "One part of an error budget.",
        "twin": "A simulation with the path, map and noise of a log, whose truth is known (`slamgauge twin`).",
        "check": "A property that every right filter has, tested by `slamgauge check`.",
        "not judged": "A check or an item of a grade that the estimate or the filter's form does not allow.",
    },
    "Verdicts": {
        "claims N times too small a sigma": (
            "NEES/3 is significantly above 1: errors are N times as large as the covariance says (overconfident)."
        ),
        "claims N times too large a sigma": (
            "NEES/3 is significantly below 1: errors are smaller than the covariance says (conservative)."
        ),
        "its sigmas are right as far as N runs show": "NEES/3 does not differ significantly from 1 in these runs.",
        "as accurate as the optimum, as accurate as the causal optimum": (
            "The 95 % interval of the ratio of the ATEs is between 0.95 and 1.05."
        ),
        "N ± N times the causal optimum's error": (
            "The ratio of the ATEs with its 95 % interval: if this is above 1, the error is significantly larger."
        ),
        "not significant": "The 95 % interval of the ratio contains 1: more runs are needed.",
        "less than the optimum's": (
            "The 95 % interval is below 0.95: the estimator may use more than the measurements."
        ),
        "innovations are N times as large as it expects": (
            "NIS/dof differs from 1 significantly: the assumed noise or the associations are wrong."
        ),
        "the cause is its linearisation or a bug": (
            "The error is too large although associations and assumed noise are right."
        ),
        "NIS does not show this": "NIS/dof is right although the covariance is wrong.",
    },
}
