"""Other programs that tests need (CONTRIBUTING.md lists them)."""

from __future__ import annotations

import os
import shutil

import pytest


def program(package: str, *names: str) -> str:
    """Return the path of the first installed program of these names, and skip the test if none is installed.

    With SLAMGAUGE_PROGRAMS=required, which `.ci/run` sets, the test fails instead.
    """
    found = next(filter(None, map(shutil.which, names)), None)
    if found is not None:
        return found
    lacking = f"no {names[0]} on the PATH; install Debian's package {package}"
    if os.environ.get("SLAMGAUGE_PROGRAMS") == "required":
        pytest.fail(lacking)
    pytest.skip(lacking)
