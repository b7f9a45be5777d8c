"""Notices on standard error, printed once per process."""

from __future__ import annotations

import sys

TOLD: set[str] = set()  # topics


def tell_once(notice: str, topic: str = "") -> None:
    """Print a line on standard error, the first time in this process that its topic (by default the line) appears."""
    topic = topic or notice
    if topic not in TOLD:
        TOLD.add(topic)
        print(f"slamgauge: {notice}", file=sys.stderr)
