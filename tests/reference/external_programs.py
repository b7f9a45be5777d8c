"""Programs of the machine that tests need, as CONTRIBUTING.md names them."""

from __future__ import annotations

import os
import shutil

import pytest


def program(package: str, *names: str) -> str:
    """The path of the first program of these names; the test is skipped where there is none.

    It fails where SLAMGAUGE_PROGRAMS=required says that there must be one, as `.ci/run` does.
    """
    found = next(filter(None, map(shutil.which, names)), None)
    if found is not None:
        return found
    lacking = f"no {names[0]} on the PATH; install Debian's package {package}"
    if os.environ.get("SLAMGAUGE_PROGRAMS") == "required":
        pytest.fail(lacking)
    pytest.skip(lacking)
