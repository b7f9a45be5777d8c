"""The studies that claims rest on: each is carried out as far as it is asked for, and no further."""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path

from slamgauge.compare.estimators.memory_check import require_room_for_runs
from slamgauge.compare.scenarios.scenario import Scenario, load_scenario
from slamgauge.compare.scenarios.simulation import informed
from slamgauge.compare.scoring.runs import Runs
from slamgauge.compare.storage.manifest import require_folder, require_free
from slamgauge.compare.storage.result_files import STORE_FILES
from slamgauge.compare.studies.claim_list import FILTER, OPTIMUM
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.compare.studies.summary import failure_lines

TOGETHER = 2  # studies in memory at a time: those of one ratio


class ClaimStudies:
    """Studies in a folder each, of the filter and of the optimum, by setting.

    An optimum is told true noise and associations; settings that simulate the same share it.

    Attributes:
        scenarios: the scenario of each setting.
    """

    def __init__(self, settings: dict[str, Scenario], seed: int, out: Path, executor: Executor) -> None:
        self.scenarios = settings
        self._seed, self._executor = seed, executor
        self._studies: dict[tuple[str, str], tuple[Scenario, Path]] = {}
        self._done: dict[Path, int] = {}
        self._failures: dict[Path, list[str]] = {}
        inside = require_folder(out, "studies")
        optima: dict[str, tuple[Scenario, Path]] = {}
        for name, scenario in settings.items():
            told = informed(scenario)
            self._studies[name, FILTER] = scenario, require_folder(inside, name)
            optimum = told, require_folder(inside, f"optimum-of-{name}")
            self._studies[name, OPTIMUM] = optima.setdefault(told.model_dump_json(), optimum)
        for _, folder in self._studies.values():
            require_free(folder, STORE_FILES)

    @property
    def failures(self) -> list[str]:
        """A line for each run that an estimator did not survive."""
        return [line for lines in self._failures.values() for line in lines]

    def require_room(self, runs: int) -> None:
        """Refuse so many runs if what a claim compares does not fit into memory.

        Raises:
            UserError: it does not.
        """
        for scenario in self.scenarios.values():
            require_room_for_runs(runs, scenario, TOGETHER)

    def load(self, setting: str, estimator: str, runs: int) -> Runs:
        """The first so many runs; those that are not there yet are carried out."""
        scenario, folder = self._studies[setting, estimator]
        if self._done.get(folder, 0) < runs:
            summary = run_study(scenario, runs, self._seed, [estimator], folder, self._executor)
            self._failures[folder] = [f"{folder.name}, {line}" for line in failure_lines(summary)]
            self._done[folder] = runs
        return load_runs(scenario, runs, self._seed, [estimator], folder)[estimator]


def sampled_settings(settings: tuple[str, ...]) -> dict[str, Scenario]:
    """The shipped scenarios of these names, the true start drawn from the prior."""
    return {name: load_scenario(name, ["start=sampled"]) for name in settings}
