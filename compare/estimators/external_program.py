"""A program in any language as an estimator: a folder of CSV files in, a CSV file out.

`compare/storage/csv_folder.py` says what stands in the files.
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

from slamgauge.compare.estimators.user_code import OwnCodeError
from slamgauge.compare.storage.csv_folder import read_estimate_csv, write_recording_csv
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Kind
from slamgauge.recording import Recording

RECORDING, ESTIMATE = "{recording}", "{estimate}"
TAIL = 2000  # bytes of what it says last that are looked at


@dataclass(frozen=True)
class ExternalProgram:
    """A program as an estimator.

    Attributes:
        command: its words; `{recording}` and `{estimate}` in them stand for the folder and the file.
        timeout: after which it is ended [s].
        kind: of its estimates.
    """

    command: tuple[str, ...]
    timeout: float
    kind: Kind

    def __call__(self, recording: Recording) -> Estimate:
        """Run it in the current folder, on files in a folder that is removed afterwards.

        Raises:
            OwnCodeError: it cannot be started, fails, takes too long, or leaves no estimate.
        """
        with tempfile.TemporaryDirectory(prefix="slamgauge-") as name:
            given, made = Path(name) / "recording", Path(name) / "out" / "estimate.csv"
            given.mkdir()
            made.parent.mkdir()
            write_recording_csv(given, recording)
            words = [word.replace(RECORDING, str(given)).replace(ESTIMATE, str(made)) for word in self.command]
            self._run(words, Path(name) / "said")
            if not made.exists():
                raise OwnCodeError(f"{self.command[0]} has written no {ESTIMATE}; write the poses to that file")
            try:
                estimate = read_estimate_csv(made, self.kind, recording.steps)
            except UserError as error:
                raise OwnCodeError(f"{self.command[0]}: {str(error).replace(f'{made.parent}{os.sep}', '')}") from None
        ids = recording.landmark
        is_told = ids is not None and np.isin(ids, estimate.landmark_ids).all()
        return replace(estimate, association=ids if is_told else None)

    def _run(self, words: list[str], said: Path) -> None:
        """Run the command to its end; what it prints is read for its last line alone."""
        with said.open("wb") as output:
            try:
                process = subprocess.Popen(
                    words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=output, start_new_session=True
                )
            except OSError as error:
                reason = error.strerror or str(error)
                raise OwnCodeError(f"{words[0]} cannot be started ({reason}); check its path and permissions") from None
            try:
                status = process.wait(self.timeout)
            except subprocess.TimeoutExpired:
                remedy = "give a longer timeout, or make it faster"
                raise OwnCodeError(f"{words[0]} was not done after {self.timeout:g} s; {remedy}") from None
            finally:
                _end(process)
        if status:
            last = _last_line(said)
            raise OwnCodeError(
                f"{words[0]} ended with status {status}{f': {last}' if last else ''}; mend it and run again"
            )


def external(command: Sequence[str], timeout: float = 600.0, kind: Kind = "filtered") -> ExternalProgram:
    """A program in any language as an estimator.

    Args:
        command: its words, `{recording}` for the folder that it reads and `{estimate}` for the file that it writes,
            for example `["./my_slam", "{recording}", "{estimate}"]`.
        timeout: after which it is ended [s].
        kind: `filtered` or `smoothed`.

    The folder holds

        start.csv         stamp,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt
        odometry.csv      step,stamp,dx,dy,dtheta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt
        observations.csv  step,landmark,range,bearing,cov_rr,cov_rb,cov_bb

    and the file that is written has the header `step,x,y,theta`, with or without the pose's covariance
    `cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt`, and a row for each of the steps 0..N. A map may be written beside it,
    as `landmarks.csv` with the header `landmark,x,y`, with or without `cov_xx,cov_xy,cov_yy`. Units are m, rad, s;
    all else is told in `slamgauge.compare.storage.csv_folder`.

    Raises:
        UserError: a command without both places, or no time.
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


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the program and all that it has started, which is the group that it leads."""
    if hasattr(os, "killpg"):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    else:  # Windows has no process groups
        process.kill()
    process.wait()


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL))
        lines = file.read().decode("utf-8", errors="replace").split("\n")
    return " ".join(next((line for line in reversed(lines) if line.strip()), "").split())[:200]
