"""Command that repeats a single run of a study."""

from __future__ import annotations

import shlex

from slamgauge.compare.studies.summary import Request, Summary


def request_of(summary: Summary) -> Request:
    """Return what a study requested; a study run from Python has no settings that are known."""
    return summary.request or Request(summary.scenario, (), ",".join(summary.estimators))


def settings_of(request: Request) -> list[str]:
    """Return the settings of a run, with the value of a sweep."""
    return [*request.settings, *filter(None, [request.swept])]


def command_of_run(summary: Summary, seed: int) -> str:
    """Return the `slamgauge run` command of a run; a comment at its end warns of settings that may be missing."""
    request = request_of(summary)
    settings = settings_of(request)
    overrides = ["--set", *settings] if settings else []
    words = ("run", request.scenario, "--seed", str(seed), *overrides, "--estimators", request.estimators)
    known = "" if summary.request else "  # add the --set options of the study, if any"
    return f"{shlex.join(('slamgauge', *words))}{known}"
