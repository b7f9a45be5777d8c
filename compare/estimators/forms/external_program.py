"""Programs in any language as estimators: they read a folder of CSV files and write a CSV file.

`compare/storage/csv_folder.py` describes the files.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from slamgauge.compare.estimators.answers import printable
from slamgauge.compare.estimators.forms.signatures import Form
from slamgauge.compare.estimators.user_errors import UserCodeError
from slamgauge.compare.storage.csv_folder import read_estimate_csv, write_recording_csv
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Kind
from slamgauge.recording import Recording

RECORDING, ESTIMATE = "{recording}", "{estimate}"
TAIL = 4000  # bytes at the end of output in which the last lines are searched


@dataclass(frozen=True)
class ExternalProgram(Form):
    """A program as an estimator; its attributes are the arguments of `external`."""

    command: tuple[str, ...]
    timeout: float
    kind: Kind

    def __call__(self, recording: Recording) -> Estimate:
        """Run the program in the current folder, on files in a temporary folder.

        Raises:
            UserCodeError: the program cannot be started, fails, exceeds the timeout, or writes no estimate.
        """
        with tempfile.TemporaryDirectory(prefix="slamgauge-") as name:
            given, made = Path(name) / "recording", Path(name) / "out" / "estimate.csv"
            given.mkdir()
            made.parent.mkdir()
            write_recording_csv(given, recording)
            words = [word.replace(RECORDING, str(given)).replace(ESTIMATE, str(made)) for word in self.command]
            self._run(words, Path(name) / "output")
            try:
                estimate = read_estimate_csv(made, self.kind, recording.steps)
            except UserError as error:
                if not made.exists():
                    what = f"has written no {ESTIMATE}; write the poses to that file"
                    raise UserCodeError(f"{words[0]} {what}") from None
                raise UserCodeError(f"{words[0]}: {str(error).replace(f'{made.parent}{os.sep}', '')}") from None
        ids = recording.landmark
        is_whole = ids is not None and np.isin(ids, estimate.landmark_ids).all()
        return replace(estimate, association=ids if is_whole else None)

    def _run(self, words: list[str], printed: Path) -> None:
        """Run the command to its end, with standard error in the file `printed`."""
        with printed.open("wb") as output:
            streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": output}
            try:
                process = subprocess.Popen(words, **streams, start_new_session=True)
            except OSError as error:
                what = f"cannot be started ({error.strerror or error}); check its path and permissions"
                raise UserCodeError(f"{words[0]} {what}") from None
            try:
                status = process.wait(self.timeout)
            except subprocess.TimeoutExpired:
                what = f"was not done after {self.timeout:g} s; give a longer timeout, or make it faster"
                raise UserCodeError(f"{words[0]} {what}") from None
            finally:
                end_group(process)
        if status:
            last = "".join(f": {line[:200]}" for line in last_lines(printed, 1))
            raise UserCodeError(f"{words[0]} ended with status {status}{last}; mend it and run again")


def external(command: Sequence[str], timeout: float = 600.0, kind: Kind = "filtered") -> ExternalProgram:
    """Make an estimator from a program in any language.

    Args:
        command: its words, with `{recording}` for the folder that it reads and `{estimate}` for the file that it
            writes, for example `["./my_slam", "{recording}", "{estimate}"]`.
        timeout: largest time of a run [s]; then the program is ended.
        kind: `filtered` or `smoothed`.

    The folder contains `start.csv`, `odometry.csv` and `observations.csv` (docs/your_filter.md lists their columns).
    The program writes a file with the header `step,x,y,theta`, with or without the covariance of the pose
    `cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt`, and one row for each of the steps 0..N. It may write a map
    into the same folder: `landmarks.csv` with the header `landmark,x,y`, with or without `cov_xx,cov_xy,cov_yy`.

    Raises:
        UserError: the command lacks one of both words, or the timeout or kind is wrong.
    """
    words = tuple(command)
    for place in (RECORDING, ESTIMATE):
        if isinstance(command, str) or not any(place in word for word in words):
            example = '["./my_slam", "{recording}", "{estimate}"]'
            raise UserError(f"external: {command!r} has no word with {place}; give a list of words like {example}")
    if not timeout > 0:
        raise UserError(f"external: timeout {timeout:g} s leaves no time; give seconds > 0")
    if kind not in ("filtered", "smoothed"):
        raise UserError(f"external: kind {kind!r} is not known; use 'filtered' or 'smoothed'")
    return ExternalProgram(words, timeout, kind)


def end_group(process: subprocess.Popen[bytes]) -> None:
    """End a process that leads a group, with all processes that it has started."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError, PermissionError):  # the group is empty
            os.killpg(process.pid, signal.SIGKILL)
    else:  # Windows has no process groups
        process.kill()
    process.wait()


def last_lines(path: Path, most: int) -> list[str]:
    """Return the last printable lines of a file of output, without empty ones."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL))
        lines = [printable(line) for line in file.read().decode("utf-8", errors="replace").splitlines()]
    return [line for line in lines if line][-most:]
