"""The command line in tests: called in this process and in a new process."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from slamgauge.compare.cli.main import main

# fifteen seconds with one loop closure, in a map of two landmarks
SHORT = ("trajectory.duration=15", "trajectory.yaw_rate=0.5", "sensor.max_range=2.4")


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def command_after(preparation: str, *arguments: object) -> list[str]:
    """Return a command that runs some code before."""
    code = f"{preparation}; import sys; from slamgauge.compare.cli.main import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-c", code, *map(str, arguments)]


def assert_equal_arrays(one: Path, other: Path) -> None:
    """Two npz files are equal to the last bit, except for computing times."""
    with np.load(one, allow_pickle=False) as first, np.load(other, allow_pickle=False) as second:
        assert {*first.files} == {*second.files}
        for field in {*first.files} - {"seconds"}:
            np.testing.assert_array_equal(first[field], second[field], field)


def metrics_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "metrics.json").read_text(encoding="utf-8"))


def contents(folder: Path) -> dict[str, bytes | None]:
    """Return every path below a folder with the bytes of files."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}
