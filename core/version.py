"""Version of slamgauge, for messages and results."""

__version__ = "0.6.0"
