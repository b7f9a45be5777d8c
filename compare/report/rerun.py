"""The command that carries out a run of a study alone, with its replay."""

from __future__ import annotations

import shlex
from itertools import takewhile
from typing import Any


def command_of_run(content: dict[str, Any], seed: int) -> str:
    """`slamgauge run` with the run's own seed, from summary.json: the settings are those of the study's command.

    Where Python has carried the study out there is no command, and the line says that settings may be missing.
    """
    command = content.get("command")
    words = shlex.split(command or "")[2:]
    scenario = words[0] if words and not words[0].startswith("--") else content["scenario"]
    chosen = ",".join(content["estimators"])
    if "--estimators" in words:  # people's own by their addresses
        chosen = words[words.index("--estimators") + 1]
    settings = ["--set", "start=sampled", *_settings(words)]
    line = shlex.join(["slamgauge", "run", scenario, "--seed", str(seed), *settings, "--estimators", chosen])
    return line if command else f"{line}  # and the study's own --set, if it had any"


def _settings(words: list[str]) -> list[str]:
    """What follows every --set."""
    places = [place for place, word in enumerate(words) if word == "--set"]
    return [each for at in places for each in takewhile(lambda word: not word.startswith("--"), words[at + 1 :])]
