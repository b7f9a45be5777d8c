"""NTNU's class as an online class: eta and P are kept here, and ids of the recording replace its association.

slamgauge check examples/adapters/ntnu_class.py:Ntnu
"""

import numpy as np
from ntnu_class_filter import EKFSLAM


class WithIds(EKFSLAM):
    given = None  # landmark of each observation, -1 for a new one; None if the recording has no ids

    def associate(self, z, zpred, S):
        return super().associate(z, zpred, S) if self.given is None else self.given


class Ntnu:
    def __init__(self, prior_mean, prior_cov):
        self.slam, self.names = WithIds(Q=None, R=None), []
        self.eta, self.P = prior_mean, prior_cov

    def predict(self, increment, cov):
        self.slam.Q = cov
        self.eta, self.P = self.slam.predict(self.eta, self.P, increment)

    def update(self, ids, values, covs):
        self.slam.R = covs[0]
        if ids is not None:
            self.slam.given = np.array([self.names.index(name) if name in self.names else -1 for name in ids])
        self.eta, self.P, nis, a = self.slam.update(self.eta, self.P, values.ravel())
        self.names += [len(self.names) + i if ids is None else ids[i] for i in np.flatnonzero(a < 0)]
        return nis, 2 * np.count_nonzero(a >= 0)

    pose = property(lambda self: self.eta[:3])
    pose_cov = property(lambda self: self.P[:3, :3])
    landmark_ids = property(lambda self: self.names)
    landmarks = property(lambda self: self.eta[3:].reshape(-1, 2))
