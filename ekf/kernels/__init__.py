"""What is compiled: the steps of landmark EKF-SLAM on preallocated arrays."""

from pathlib import Path

from slamgauge.compiled import drop_outdated

drop_outdated(Path(__file__).parent)
