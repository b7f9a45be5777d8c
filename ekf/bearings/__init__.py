"""Bearings alone: landmarks are initialised as rays, in inverse depth, or delayed, until they are points."""
