"""Bearing-only SLAM: landmarks start as rays, or delayed."""
