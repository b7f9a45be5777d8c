"""One simulated run of a scenario: `slamgauge run`."""

from __future__ import annotations

import shlex
from pathlib import Path

from slamgauge.compare.cli.options.run import DEFAULT_ESTIMATORS, Run
from slamgauge.compare.cli.options.shared import flattened, split_names
from slamgauge.compare.cli.scoring import Data, FilterSettings, Source, score
from slamgauge.compare.cli.steps import isolated, overridden_scenario, write_page
from slamgauge.compare.estimators.requests import Asked, ask
from slamgauge.compare.estimators.running import require_room_for_estimates
from slamgauge.compare.scenarios.scenario import Scenario, scenario_text
from slamgauge.compare.scenarios.simulation import simulate_informed
from slamgauge.compare.storage.result_files import METRICS
from slamgauge.compare.storage.safe_names import file_name, shown
from slamgauge.compare.storage.staged_folder import require_ours


def run(command: Run) -> int:
    """Run the command; return the exit status."""
    asked = isolated(ask(split_names(command.estimators)), command.own_code)
    scenario = overridden_scenario(command.scenario, command.set)
    out = command.out or Path("results") / f"{file_name(scenario.name)}-seed-{command.seed}"
    status = _score(command, scenario, asked, out)  # its memory is free again before the page is written
    return status if write_page(out, METRICS, command.page) else 1


def _score(command: Run, scenario: Scenario, asked: list[Asked], out: Path) -> int:
    require_ours(out)
    truth, recording, informed = simulate_informed(scenario, command.seed)
    require_room_for_estimates(informed, asked)
    settings = FilterSettings(scenario.association, scenario.initialisation_settings, scenario.robustness)
    source = Source(scenario.name, command.seed, scenario_text(scenario), _study_command(command))
    return score(Data(truth, recording, informed), asked, settings, out, command.output, source)


def _study_command(command: Run) -> str:
    """Return the command of many runs with the same scenario, settings and estimators."""
    words = ["slamgauge", "study", command.scenario, "--runs", "100"]
    words += ["--estimators", command.estimators] if command.estimators != DEFAULT_ESTIMATORS else []
    words += ["--set", *flattened(command.set)] if command.set else []
    return shown(shlex.join(words))
