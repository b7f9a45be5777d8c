"""Where results come from: the version, the command and the scenario, which stand in their JSON files."""

from __future__ import annotations

import shlex
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar

from slamgauge.version import __version__

_COMMAND: ContextVar[str | None] = ContextVar("_COMMAND", default=None)


@contextmanager
def commanded(words: Sequence[str]) -> Generator[None]:
    """Within the block results are those of the command `slamgauge WORDS`."""
    token = _COMMAND.set(shlex.join(["slamgauge", *words]))
    try:
        yield
    finally:
        _COMMAND.reset(token)


def origin(scenario_text: str | None) -> dict[str, str | None]:
    """What a JSON file of results tells of its origin; the command is None where Python has made them.

    Args:
        scenario_text: the scenario as a TOML file, overrides included; None without a scenario.
    """
    return {"version": __version__, "command": _COMMAND.get(), "scenario_text": scenario_text}
