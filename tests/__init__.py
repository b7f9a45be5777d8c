"""Tests of slamgauge; `python -m tests` runs them and the other checks."""
