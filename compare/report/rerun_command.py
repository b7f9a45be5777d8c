"""The command that carries out a run of a study alone, with its replay."""

from __future__ import annotations

import json
import shlex
import tomllib
from functools import reduce
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

    Where Python has carried the study out there is no command. Of a sweep's value its own setting is added.
    """
    words = _words(content)
    scenario = words[0] if words and not words[0].startswith("--") else content["scenario"]
    chosen = ",".join(content["estimators"])
    if "--estimators" in words:  # people's own by their addresses
        chosen = words[words.index("--estimators") + 1]
    settings = ["start=sampled", *_settings(words), *filter(None, [swept(content)])]
    return Rerun(scenario, seed, settings, chosen, bool(words))


def swept(content: dict[str, Any]) -> str:
    """`key=value` of a study that is a value of a sweep; the value stands in the scenario's text. Empty of others."""
    words = _words(content)
    if "--sweep" not in words:
        return ""
    key = words[words.index("--sweep") + 1].partition("=")[0].strip()
    value = reduce(lambda table, name: table[name], key.split("."), tomllib.loads(content["scenario_text"]))
    return f"{key}={value if isinstance(value, str) else json.dumps(value)}"


def _words(content: dict[str, Any]) -> list[str]:
    """What follows `slamgauge study`; `--option=value` as two words."""
    words = shlex.split(content.get("command") or "")[2:]
    return [part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])]


def _settings(words: list[str]) -> list[str]:
    """What follows every --set."""
    places = [place for place, word in enumerate(words) if word == "--set"]
    return [each for at in places for each in takewhile(lambda word: not word.startswith("--"), words[at + 1 :])]
