"""On PYTHONPATH it stands for a machine where GTSAM cannot be had: `PYTHONPATH=tests/without_gtsam pytest`."""

raise ImportError("there is no gtsam")
