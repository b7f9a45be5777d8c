"""Tests of slamgauge, run by `pytest`."""
