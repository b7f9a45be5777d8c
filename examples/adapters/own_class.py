"""A class of one's own as an online class.

slamgauge check examples/adapters/own_class.py:Wrapper
"""

from own_class_filter import EkfSlam


class Wrapper:
    def __init__(self, prior_mean, prior_cov):
        self.filter = EkfSlam(prior_mean, prior_cov, Q=None, R=None)

    def predict(self, increment, cov):
        self.filter.Q = cov[[0, 2]][:, [0, 2]]  # dt = 1: the way and the turn of a step are speed and yaw rate
        self.filter.motion_update(increment[0], increment[2], dt=1.0)

    def update(self, ids, values, covs):
        self.filter.R = covs[0]
        self.filter.sensor_update([(name, r, bearing) for name, (r, bearing) in zip(ids, values, strict=True)])

    pose = property(lambda self: self.filter.x[:3])
    pose_cov = property(lambda self: self.filter.P[:3, :3])
    landmark_ids = property(lambda self: [*self.filter.index])
    landmarks = property(lambda self: self.filter.x[3:].reshape(-1, 2))
