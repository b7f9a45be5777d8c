"""Command that repeats a single run of a study."""

from __future__ import annotations

import json
import shlex
import tomllib
from functools import reduce
from itertools import takewhile
from typing import Any, NamedTuple


class Rerun(NamedTuple):
    """Arguments of `slamgauge run`; `is_known` is False if the settings of the study are not known."""

    scenario: str
    seed: int
    settings: list[str]
    estimators: str
    is_known: bool


def command_of_run(content: dict[str, Any], seed: int) -> str:
    """Return the `slamgauge run` command of a run; a comment at its end warns of settings that may be missing."""
    run = run_of_study(content, seed)
    settings = ["--set", *run.settings]
    line = shlex.join(
        ["slamgauge", "run", run.scenario, "--seed", str(seed), *settings, "--estimators", run.estimators]
    )
    return line if run.is_known else f"{line}  # add the --set options of the study, if any"


def run_of_study(content: dict[str, Any], seed: int) -> Rerun:
    """Return the arguments that repeat the run with a seed, from the content of summary.json.

    The settings are those of the command of the study; a study run from Python has none. For a value of a sweep, its
    setting is added.
    """
    words = _words(content)
    scenario = words[0] if words and not words[0].startswith("--") else content["scenario"]
    chosen = ",".join(content["estimators"])
    if "--estimators" in words:  # user estimators with their addresses
        chosen = words[words.index("--estimators") + 1]
    settings = ["start=sampled", *_settings(words), *filter(None, [swept(content)])]
    return Rerun(scenario, seed, settings, chosen, bool(words))


def swept(content: dict[str, Any]) -> str:
    """Return `key=value` of a study in a sweep, read from its scenario; empty for other studies."""
    words = _words(content)
    if "--sweep" not in words:
        return ""
    key = words[words.index("--sweep") + 1].partition("=")[0].strip()
    value = reduce(lambda table, name: table[name], key.split("."), tomllib.loads(content["scenario_text"]))
    return f"{key}={value if isinstance(value, str) else json.dumps(value)}"


def _words(content: dict[str, Any]) -> list[str]:
    """Return the words after `slamgauge study`; `--option=value` becomes two words."""
    words = shlex.split(content.get("command") or "")[2:]
    return [part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])]


def _settings(words: list[str]) -> list[str]:
    """Return the arguments of all --set options."""
    places = [place for place, word in enumerate(words) if word == "--set"]
    return [each for at in places for each in takewhile(lambda word: not word.startswith("--"), words[at + 1 :])]
