"""The Octave course's two functions as an estimator: the state has a place for each landmark of the recording.

slamgauge check examples/adapters/octave_course.py:estimate
"""

import numpy as np
import octave_course_filter as course

from slamgauge import Estimate


def estimate(recording):
    names = sorted({*recording.landmark.tolist()})  # the course numbers landmarks from 0
    size = 3 + 2 * len(names)
    mu, sigma, observed = np.zeros(size), np.zeros((size, size)), np.zeros(len(names), bool)
    mu[:3], sigma[:3, :3] = recording.prior_mean, recording.prior_cov
    poses, covs = [], []
    for step, scan in enumerate(recording.scans()):
        if step > 0:
            (dx, dy, turn), cov = recording.odometry[step - 1], recording.odometry_cov[step - 1]
            c, s = np.cos(mu[2]), np.sin(mu[2])
            to_world = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            course.MOTION_NOISE = to_world @ cov @ to_world.T
            r1 = np.arctan2(dy, dx)
            mu, sigma = course.prediction_step(mu, sigma, {"r1": r1, "t": np.hypot(dx, dy), "r2": turn - r1})
        z = [
            {"id": names.index(name), "range": r, "bearing": b}
            for name, (r, b) in zip(scan.landmark, scan.value, strict=True)
        ]
        if z:
            course.SENSOR_NOISE = scan.cov[0]
            mu, sigma, observed = course.correction_step(mu, sigma, z, observed)
        poses.append(mu[:3].copy())
        covs.append(sigma[:3, :3].copy())
    map_covs = [sigma[at : at + 2, at : at + 2] for at in range(3, size, 2)]
    ids, landmarks = np.array(names, np.int64), mu[3:].reshape(-1, 2)
    return Estimate("filtered", np.array(poses), np.array(covs), ids, landmarks, np.reshape(map_covs, (-1, 2, 2)))
