"""The command that carries out a run of a study alone, with its replay."""

from __future__ import annotations

import shlex
from itertools import takewhile
from typing import Any, NamedTuple


class Rerun(NamedTuple):
    """What `slamgauge run` is to be given; `is_known` is False where the study's own settings are not."""

    scenario: str
    seed: int
    settings: list[str]
    estimators: str
    is_known: bool


def command_of_run(content: dict[str, Any], seed: int) -> str:
    """`slamgauge run` with the run's own seed; the line says so where settings may be missing."""
    run = run_of_study(content, seed)
    settings = ["--set", *run.settings]
    line = shlex.join(
        ["slamgauge", "run", run.scenario, "--seed", str(seed), *settings, "--estimators", run.estimators]
    )
    return line if run.is_known else f"{line}  # and the study's own --set, if it had any"


def run_of_study(content: dict[str, Any], seed: int) -> Rerun:
    """A run of a study by its seed, from summary.json: the settings are those of the study's command.

    Where Python has carried the study out there is no command.
    """
    command = content.get("command")
    words = shlex.split(command or "")[2:]
    scenario = words[0] if words and not words[0].startswith("--") else content["scenario"]
    chosen = ",".join(content["estimators"])
    if "--estimators" in words:  # people's own by their addresses
        chosen = words[words.index("--estimators") + 1]
    return Rerun(scenario, seed, ["start=sampled", *_settings(words)], chosen, bool(command))


def _settings(words: list[str]) -> list[str]:
    """What follows every --set."""
    places = [place for place, word in enumerate(words) if word == "--set"]
    return [each for at in places for each in takewhile(lambda word: not word.startswith("--"), words[at + 1 :])]
