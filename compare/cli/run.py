"""One simulated run of a scenario: `slamgauge run`; and the part that `run` and `evaluate` share."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from slamgauge.compare.cli.common import Estimators, OfScenario, OwnCode, WithPage, flattened, staged
from slamgauge.compare.estimators import loading, requests, running
from slamgauge.compare.scenarios import scenario as scenarios
from slamgauge.compare.scenarios import simulation
from slamgauge.compare.scoring import comparison
from slamgauge.compare.storage import files
from slamgauge.compare.storage.result_files import METRICS, file_name, shown
from slamgauge.errors import UserError

if TYPE_CHECKING:
    from slamgauge.compare.scenarios.schema import Association
    from slamgauge.ekf.settings import Initialisation, Robustness
    from slamgauge.recording import Recording
    from slamgauge.truth import Truth

    Settings = tuple[Association, Initialisation | None, Robustness]

DEFAULT_ESTIMATORS = "ekf,riekf,causal,batch"
FRAMES = 240  # maps that filters store for pictures


@dataclass
class Command(OfScenario, WithPage):
    """Simulate one run of a scenario and score estimators on it.

    For example:
      slamgauge run q1-long-dense --estimators ekf,riekf,causal,batch
      slamgauge run q2-long-dense --seed 3 --set association.gate=25 start=mean

    Attributes:
        seed: Seed of all noise.
        out: Folder of the results. If not given: results/SCENARIO-seed-SEED.
    """

    seed: int = 0
    estimators: Estimators = DEFAULT_ESTIMATORS
    own_code: OwnCode = field(default_factory=OwnCode)
    out: Path | None = None

    def run(self) -> int:
        scenario, asked = self.load(), self.own_code.ask(self.estimators)
        out = self.out or Path("results") / f"{file_name(scenario.name)}-seed-{self.seed}"
        simulated = (scenario.name, self.seed, scenarios.scenario_text(scenario))
        data = Data(*simulation.simulate_informed(scenario, self.seed), simulated, self._study_command())
        settings = (scenario.association, scenario.initialisation_settings, scenario.robustness)
        return score(self, out, data, asked, settings)

    def _study_command(self) -> str:
        """Return the command of many runs with the same scenario, settings and estimators."""
        words = ["slamgauge", "study", self.scenario, "--runs", "100"]
        words += ["--estimators", self.estimators] if self.estimators != DEFAULT_ESTIMATORS else []
        words += ["--set", *flattened(self.set)] if self.set else []
        return shown(shlex.join(words))


class Data(NamedTuple):
    """What is scored."""

    truth: Truth | None
    recording: Recording  # input of the estimators
    informed: Recording | None = None  # input of the optima, if it is another one
    simulated: tuple[str | None, int | None, str | None] = (None, None, None)  # scenario, seed, scenario as TOML
    study: str = ""  # command of many runs
    twins: int = 0  # number of simulated twins of the test without ground truth
    failures: Mapping[str, str] = MappingProxyType({})  # why stored estimates cannot be read, by label


def score(command: WithPage, out: Path | None, data: Data, asked: Sequence[requests.Asked], settings: Settings) -> int:
    """Run the estimators, print the table, and write folder, figures and page; return the exit status."""
    if not asked and not data.failures:
        raise UserError("estimators: none given; name at least one, for example --estimators ekf,batch")
    running.require_room_for_estimates(data.informed or data.recording, asked)
    association, initialisation, robust = settings
    estimators, failures = loading.load_each(asked, association, initialisation, FRAMES, robust)
    failures |= data.failures
    if not estimators:
        raise UserError(next(iter(failures.values())))
    with staged(out, METRICS) as folder:
        found = comparison.compare_estimators(data.truth, data.recording, estimators, data.informed, twins=data.twins)
        found = replace(found, failures=failures | found.failures, study=data.study)
        content = comparison.metrics(found, *data.simulated)
        command.output.show(content, comparison.table(found))
        if folder is not None:
            with files.explained(out or folder, "written"):
                comparison.write_comparison(folder, found, content)
    done = not found.failures
    del found, estimators  # figures and page are made from the folder
    return command.finish(out, METRICS, done=done)
