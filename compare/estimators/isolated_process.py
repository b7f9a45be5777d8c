"""User code in separate processes: each receives one recording, behind a wall and without the truth.

Every run is a new process (`launched_process`). `docs/your_filter.md` describes the wall.
"""

from __future__ import annotations

import os
from time import monotonic
from typing import NamedTuple

from slamgauge.compare.estimators.answers import Spent, address_fields, message
from slamgauge.compare.estimators.launched_process import Launcher, Process
from slamgauge.compare.estimators.user_code import Address, UserCodeError
from slamgauge.compare.estimators.wall import require_wall
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

STARTING = 120.0  # s: largest time for the imports of Python, slamgauge and libraries


def require_isolation(remedy: str, *, unconfined: bool) -> None:
    """Refuse where this system cannot isolate user code.

    Raises:
        UserError: with the remedy.
    """
    if not can_isolate():
        raise UserError(f"Windows cannot run user code in isolation; {remedy}")
    require_wall(unconfined=unconfined)


def can_isolate() -> bool:
    """Return whether this system can isolate user code: it needs process groups, which Windows lacks."""
    return hasattr(os, "killpg")


class IsolatedRun(NamedTuple):
    """A run of user code.

    Attributes:
        estimate: what it returned.
        spent: its times.
        remarks: see `forms.form.remarks_of`.
        replaces_noise: see `forms.form.replaces_noise`.
    """

    estimate: Estimate
    spent: Spent
    remarks: list[str]
    replaces_noise: bool


class Isolated:
    """An estimator that runs in a new process each time.

    Args:
        where: address of the user code; without an attribute the child finds the callable.
        timeout: largest time of a run, and of loading [s].
        unconfined: whether the processes run without a wall.
    """

    def __init__(self, where: Address, timeout: float, *, unconfined: bool = False) -> None:
        self.where, self.timeout, self.unconfined = where, timeout, unconfined
        self.spent = Spent(0.0, 0.0)
        self.replaces_noise = False  # in the last run (see `forms.form.replaces_noise`)
        self._remarks: list[str] = []
        self._launcher: Launcher | None = None
        self._form = ""
        self._loaded: Process | None = None  # it waits for a recording
        self._last_lines: list[str] = []

    def begin(self) -> str:
        """Load the code in a process that waits for a recording; return the description of its form (see `adapters`).

        Raises:
            UserCodeError: the code cannot be loaded.
            UserError: this system has no wall.
        """
        if self._loaded is not None:
            return self._form
        if self._launcher is None:
            self._launcher = Launcher(self.where, unconfined=self.unconfined)
        process = Process(self._launcher)
        try:
            self._form = self._loaded_form(process)
        except UserCodeError:
            process.end()
            raise
        self._loaded = process
        return self._form

    def _loaded_form(self, process: Process) -> str:
        try:
            process.exchange(message(address_fields(self.where)), STARTING)
            answer = process.exchange(b"", self.timeout)
            attribute, form = answer.text("attribute"), answer.text("form")
        except UserCodeError as error:
            raise type(error)(f"estimator {self.where.text}: cannot be loaded, {error}") from error
        if answer.reason:
            raise UserCodeError(answer.reason)
        self.where = self.where._replace(attribute=attribute)
        return form

    def __call__(self, recording: Recording) -> Estimate:
        """Run the estimator, and keep times and remarks of the run.

        Raises:
            UserCodeError: the code raised an error, exceeded the timeout, or ended its process.
        """
        run = self.run(recording)
        self.spent, self._remarks, self.replaces_noise = run.spent, run.remarks, run.replaces_noise
        return run.estimate

    def run(self, recording: Recording) -> IsolatedRun:
        """Run the estimator.

        Raises:
            UserCodeError: as `__call__`.
        """
        self.begin()
        process, self._loaded = self._loaded, None
        assert process is not None
        start = monotonic()
        try:
            answer = process.exchange(message({}, recording), self.timeout)
        finally:
            process.end()
            self._last_lines = process.last_lines
        if answer.reason:
            raise UserCodeError(answer.reason)
        spent = answer.spent(monotonic() - start)
        return IsolatedRun(answer.estimate(), spent, answer.texts("remarks"), answer.flag("replaces_noise"))

    def remarks(self, _recording: Recording) -> list[str]:
        """Return the remarks on the last run (see `forms.form.remarks_of`)."""
        return self._remarks

    @property
    def last_output(self) -> str:
        """The last lines that it printed in the last run."""
        return "\n".join(self._last_lines)

    def close(self) -> None:
        """End all processes."""
        if self._loaded is not None:
            self._loaded.end()
            self._loaded = None
        if self._launcher is not None:
            self._launcher.end()
            self._launcher = None
