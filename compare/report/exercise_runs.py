"""Run 0 of a setting of the exercise: its results, figure and page with a replay, as `slamgauge run` writes them."""

from __future__ import annotations

from concurrent.futures import Executor, as_completed
from pathlib import Path

from slamgauge.compare.estimators.loading import load_estimators
from slamgauge.compare.exercise.results import SettingResult
from slamgauge.compare.exercise.settings import DEAD_RECKONING, EKF, FILTERS, GTSAM, OPTIMA, Setting
from slamgauge.compare.figures.exercise_figures import save_setting_figure
from slamgauge.compare.report.run_page import run_page
from slamgauge.compare.scenarios.scenario import Scenario, scenario_text
from slamgauge.compare.scenarios.simulation import simulate, simulate_informed
from slamgauge.compare.scoring.comparison import compare_estimators, digest, metrics, write_comparison
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.progress import counted
from slamgauge.compare.storage.result_files import METRICS, RUN_0
from slamgauge.compare.storage.staged_folder import staged_folder
from slamgauge.compare.studies.study_run import run_seed
from slamgauge.version import __version__

FRAMES = 240  # maps that the filter stores for the replay
DRAWN = (DEAD_RECKONING, EKF, GTSAM)


def publish_first_runs(settings: list[SettingResult], seed: int, out: Path, executor: Executor) -> None:
    """Write run 0 of the settings into `out`, each into the folder of its figure; complete folders are kept.

    Raises:
        UserError: a foreign file would be replaced, or a folder cannot be written.
    """
    folder = out / RUN_0
    tasks = [(each.setting, each.scenario, run_seed(seed, 0), folder / each.setting.figure) for each in settings]
    missing = [task for task in tasks if not _is_complete(*task)]
    with counted(len(tasks), "setting", "run 0 with replay", len(tasks) - len(missing)) as progress:
        for done in as_completed([executor.submit(publish_first_run, *task) for task in missing]):
            done.result()
            progress.update()


def publish_first_run(setting: Setting, scenario: Scenario, seed: int, folder: Path) -> None:
    """Write a run of a setting into `folder`: estimates, metrics, the handout's figure, and a page with a replay."""
    names = _estimators_of(setting)
    truth, recording, exact = simulate_informed(scenario, seed)
    estimators = load_estimators(names, scenario.association, scenario.initialisation_settings, FRAMES)
    comparison = compare_estimators(truth, recording, estimators, exact)
    content = metrics(comparison, scenario.name, seed, scenario_text(scenario))
    title = f"Figure {setting.figure}, {setting.title} ({setting.scenario}), run 0"
    with staged_folder(folder, METRICS) as stage:
        write_comparison(stage, comparison, content)
        drawn = {name: comparison.estimates[name] for name in DRAWN if name in comparison.estimates}
        save_setting_figure(stage / "figure", truth, recording, drawn, title)
        for name, text in run_page(stage).items():
            (stage / name).write_text(text, encoding="utf-8", newline="\n")


def _estimators_of(setting: Setting) -> list[str]:
    return [*FILTERS, *OPTIMA, *setting.extra]


def _is_complete(setting: Setting, scenario: Scenario, seed: int, folder: Path) -> bool:
    """Return whether the folder has the results of this run by this version."""
    if not (folder / METRICS).is_file():
        return False
    content = read_json(folder / METRICS, "exercise")
    known = {*content.get("estimators", ()), *(each["estimator"] for each in content.get("failures", ()))}
    if content.get("version") != __version__ or known != {*_estimators_of(setting)}:
        return False
    return content.get("digest") == digest(simulate(scenario, seed)[1])
