"""Command that repeats a single run of a study."""

from __future__ import annotations

import json
import shlex
import tomllib
from functools import reduce
from itertools import takewhile
from typing import Any, NamedTuple


class Rerun(NamedTuple):
    """Arguments of `slamgauge run`."""

    scenario: str
    settings: list[str]
    estimators: str


def command_of_run(content: dict[str, Any], seed: int) -> str:
    """Return the `slamgauge run` command of a run; a comment at its end warns of settings that may be missing."""
    scenario, settings, estimators = run_of_study(content)
    overrides = ["--set", *settings] if settings else []
    words = ("run", scenario, "--seed", str(seed), *overrides, "--estimators", estimators)
    known = "" if content.get("command") else "  # add the --set options of the study, if any"
    return f"{shlex.join(('slamgauge', *words))}{known}"


def run_of_study(content: dict[str, Any]) -> Rerun:
    """Return the arguments that repeat a run, from the content of summary.json.

    The settings are those of the command of the study; a study run from Python has none. For a value of a sweep, its
    setting is added.
    """
    words = _words(content)
    scenario = words[0] if words and not words[0].startswith("--") else content["scenario"]
    chosen = ",".join(content["estimators"])
    if "--estimators" in words:  # user estimators with their addresses
        chosen = words[words.index("--estimators") + 1]
    places = [place for place, word in enumerate(words) if word == "--set"]
    given = [each for at in places for each in takewhile(lambda word: not word.startswith("--"), words[at + 1 :])]
    return Rerun(scenario, [*given, *filter(None, [swept(content)])], chosen)


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
