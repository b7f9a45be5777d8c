"""Sizes of the test run: `python -m tests quick`, `python -m tests` and `python -m tests full`."""

from __future__ import annotations

SIZES = ("quick", "usual", "full")  # each contains the sizes before it
USUAL = "usual"

NOT_QUICK = (  # files and folders whose tests start programs or simulate many runs
)

FULL = {  # beginning of a test's id -> why only the full run has it
}


def size_of(test: str) -> str:
    """Return the smallest size that contains a test, given by its pytest id (`tests/FILE.py::NAME[PARAMETERS]`)."""
    if test.startswith((*FULL,)):
        return "full"
    return USUAL if test.startswith(NOT_QUICK) else "quick"
