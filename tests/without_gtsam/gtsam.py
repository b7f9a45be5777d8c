"""Make GTSAM unavailable: `PYTHONPATH=tests/without_gtsam pytest`."""

raise ImportError("there is no gtsam")
