"""Filters beyond the fast EKF family: compressed map, sliding window, sigma points, robot-centred map."""
