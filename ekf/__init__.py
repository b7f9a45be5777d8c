"""Planar landmark SLAM filters."""
