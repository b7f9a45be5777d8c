"""Compiled steps of landmark EKF-SLAM on preallocated arrays."""
