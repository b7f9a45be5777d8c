"""Bearing-only SLAM: landmarks start as rays, in inverse depth, or delayed."""
