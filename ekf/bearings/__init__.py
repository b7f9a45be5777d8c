"""Bearings alone: landmarks that begin as rays, in inverse depth, or delayed, until they are points."""
