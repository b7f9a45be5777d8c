"""Sensor models, one file each; `slamgauge.sensors` has the table and the functions for a sensor by name."""
