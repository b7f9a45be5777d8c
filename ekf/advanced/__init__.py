"""Filters beyond the fast EKF family: compressed map, sliding window, sigma points, robocentric map."""
