"""Provenance of results: the version, the command and the scenario that JSON files record."""

from __future__ import annotations

import shlex
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from slamgauge.version import __version__

_COMMAND: ContextVar[str | None] = ContextVar("_COMMAND", default=None)


@contextmanager
def commanded(words: Sequence[str]) -> Generator[None]:
    """Record `slamgauge WORDS` as the command of all results in the block."""
    token = _COMMAND.set(shlex.join(["slamgauge", *words]))
    try:
        yield
    finally:
        _COMMAND.reset(token)


def origin(scenario_text: str | None) -> dict[str, str | None]:
    """Return version, command and scenario for a JSON file; results of a Python program have no command.

    Args:
        scenario_text: The scenario as TOML, overrides included; None without a scenario.
    """
    return {"version": __version__, "command": _COMMAND.get(), "scenario_text": scenario_text}
