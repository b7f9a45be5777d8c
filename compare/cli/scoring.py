"""The part that `run` and `evaluate` share: from requested estimators to table and folder."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from slamgauge.compare.cli.steps import draw, results_folder
from slamgauge.compare.cli.terminal import Output
from slamgauge.compare.estimators.loading import load_each
from slamgauge.compare.estimators.requests import Asked
from slamgauge.compare.scenarios.schema import Association
from slamgauge.compare.scoring.comparison import (
    compare_estimators,
    metrics,
    table,
    write_comparison,
)
from slamgauge.compare.storage.files import explained
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.ekf.settings import Initialisation, Robustness
from slamgauge.errors import UserError
from slamgauge.memory import give_back
from slamgauge.recording import Recording
from slamgauge.truth import Truth

FRAMES = 240  # maps that filters store for pictures


@dataclass(frozen=True)
class FilterSettings:
    """Settings of the filters."""

    association: Association
    initialisation: Initialisation | None
    robust: Robustness


@dataclass(frozen=True)
class Source:
    """Where a recording comes from: its scenario, seed and text, and a command of many runs, if it is simulated.

    `twins` is the number of simulated twins of the test without ground truth.
    """

    scenario: str | None = None
    seed: int | None = None
    text: str | None = None
    study: str = ""
    twins: int = 0


class Data(NamedTuple):
    """What is scored: truth and recording, and the recording that the optima receive."""

    truth: Truth | None
    recording: Recording
    informed: Recording | None = None


def score(
    data: Data, asked: Sequence[Asked], settings: FilterSettings, out: Path | None, output: Output, source: Source
) -> int:
    """Run the estimators, print the table and write the folder; return 1 if an estimator failed, else 0."""
    if not asked:
        raise UserError("estimators: none given; name at least one, for example --estimators ekf,batch")
    estimators, failures = load_each(asked, settings.association, settings.initialisation, FRAMES, settings.robust)
    if not estimators:
        raise UserError(next(iter(failures.values())))
    with results_folder(out, METRICS) as folder:
        comparison = compare_estimators(data.truth, data.recording, estimators, data.informed, twins=source.twins)
        give_back()
        comparison = replace(comparison, failures=failures | comparison.failures, study=source.study)
        content = metrics(comparison, source.scenario, source.seed, source.text)
        output.show(content, table(comparison))
        done = not comparison.failures
        if folder is not None and out is not None:
            with explained(out, "written"):
                write_comparison(folder, comparison, content)
    if out is not None:
        del comparison  # the figures are drawn from the folder
        done = draw(out, METRICS) and done
        print(f"written to {out}", file=sys.stderr)
    return 0 if done else 1
