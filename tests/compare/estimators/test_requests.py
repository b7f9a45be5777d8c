"""User code at addresses: identified by its digest, loaded from its folder or a copy, refused if it uses the future."""

from __future__ import annotations

import importlib
import warnings
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamgauge.compare.estimators.loading import load
from slamgauge.compare.estimators.requests import Limits, ask, with_limits
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.studies.executors import dask_cluster
from slamgauge.compare.studies.study import run_study
from slamgauge.compare.studies.study_run import run_once
from slamgauge.ekf import dead_reckoning
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

from .conftest import EXAMPLES, short

pytestmark = pytest.mark.slow

MINE = "from helper import chosen\ndef estimate(recording):\n    return chosen(recording)\n"
HELPER = "from slamgauge.ekf import {} as chosen\n"
SHORT = ["start=sampled", "trajectory.duration=2"]
SCENARIO = load_scenario("q1-short-dense", SHORT)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "helper.py").write_text(HELPER.format("ekf_slam"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_edited_code_is_another_estimator(folder: Path) -> None:
    found: list[Any] = []
    with ThreadPoolExecutor(1) as executor:
        for name in ("ekf_slam", "dead_reckoning", "ekf_slam"):
            (folder / "helper.py").write_text(HELPER.format(name))
            chosen = ["ekf", "mine=mine.py:estimate"]
            found.append(run_study(SCENARIO, 2, 0, chosen, folder / "study", executor).estimators)
    first, edited, again = found
    assert first["mine"]["ate_m"] == first["ekf"]["ate_m"] == again["mine"]["ate_m"]
    assert edited["mine"]["ate_m"] != first["mine"]["ate_m"]
    assert edited["ekf"] == first["ekf"]


def test_an_edited_installed_module_is_another_estimator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "installed_filter").mkdir()
    keys = set[str]()
    for content in ("", "edited = 1"):
        for name in ("__init__", "gains"):
            (tmp_path / f"installed_filter/{name}.py").write_text(content)
            importlib.invalidate_caches()
            keys.add(ask(["mine=installed_filter.gains:estimate"])[0].key)
    assert len(keys) == 4
    assert ask(["mine=numpy:array"])[0].key == ask(["mine=numpy:array"])[0].key != ask(["mine=scipy:array"])[0].key


def test_code_is_copied_to_the_workers_of_a_cluster(folder: Path) -> None:
    from distributed import LocalCluster

    asked = ask(["ekf", "mine=mine.py:estimate"])
    for path in folder.glob("*.py"):
        path.unlink()  # another machine has none of them
    cluster: Any = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with cluster, dask_cluster(cluster.scheduler_address) as executor:
        summary = run_study(SCENARIO, 4, 0, asked, folder / "study", executor)
    assert summary.failures == ()
    assert summary.estimators["mine"]["ate_m"] == summary.estimators["ekf"]["ate_m"]


def test_a_map_without_ids_causes_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (outcome,) = run_once(load_scenario("q2-short-dense", SHORT), 0, [f"{EXAMPLES}/student_ekf.py:ekf_slam"])
    assert (outcome.error, outcome.figures["landmark_rmse_m"]) == (None, None)


def test_a_study_takes_callables_and_lists_failures_by_label(folder: Path) -> None:
    def fails(_: object) -> None:
        raise ZeroDivisionError

    chosen: Any = {"ours": "ekf", "theirs": dead_reckoning, "broken": fails}
    with ThreadPoolExecutor(1) as executor:
        summary = run_study(SCENARIO, 1, 0, chosen, folder / "study", executor)
    assert [*summary.estimators] == [*chosen]
    assert {failure.estimator for failure in summary.failures} == {"broken"}


# --- estimates that use the future -------------------------------------------------------------

HEAD = """
from dataclasses import replace
import numpy as np
from slamgauge import Estimate, chain
known = {}

def later(rows):
    return np.concatenate([rows[1:], rows[-1:]])

def estimate(recording):
    covs = np.cumsum([recording.prior_cov, *recording.odometry_cov], axis=0)
    right = Estimate("filtered", chain(recording.prior_mean, recording.odometry), covs)
"""
BATCH = "from slamgauge import batch; return replace(batch(recording), kind={!r})"
DRAWN = """draw = np.random.default_rng({})
    return replace(right, poses=right.poses + np.array([draw.normal(0.0, 0.1, 3) for _ in right.poses]))"""
REMEMBERS = """known.setdefault("poses", later(right.poses))
    return replace(right, poses=known["poses"][: len(right.poses)])"""
GUESSES = """is_end = np.arange(len(right.poses)) % 20 == 0  # a quarter of the recording
    return replace(right, poses=np.where(is_end[:, None], right.poses, later(right.poses)))"""


def run(folder: Path, source: str, recording: Recording) -> Estimate:
    """Run a file, or a file with these statements, with the check for use of the future."""
    (folder / "mine.py").write_text(f"{HEAD}    {source}\n")
    where = source if ".py:" in source else f"{folder / 'mine.py'}:estimate"
    (asked,) = with_limits(ask([f"mine={where}"]), Limits(120.0), strict=True)
    return run_estimator("mine", load(asked, announced=False), recording)[0]


@pytest.mark.parametrize(
    "source",
    [
        f"{EXAMPLES}/student_ekf.py:ekf_slam",
        "return replace(right, pose_covs=None)",
        BATCH.format("smoothed"),
        DRAWN.format(3),
    ],
    ids=["step function", "no covariances", "smoothed and declared as such", "random and seeded"],
)
def test_estimates_that_use_only_the_past_pass(tmp_path: Path, source: str):
    assert len(run(tmp_path, source, short()).poses) == short().steps + 1


@pytest.mark.parametrize(
    ("source", "what"),
    [
        (
            "return replace(right, poses=later(right.poses))",
            r"from the recording up to step (\d+) alone, the pose of step \1 is another, \S+ m or rad away; store",
        ),
        (BATCH.format("filtered"), r"from the recording up to step \d+ alone, the pose of step"),
        ("return replace(right, pose_covs=later(covs))", r"the covariance of step \d+ is another; store a pose"),
        (REMEMBERS, r"from the recording up to step (\d+) alone, the pose of step \1"),
        ("return replace(right, poses=right.poses[:4], pose_covs=None)", "returned 4 poses"),
        (GUESSES, "uses the future"),  # no code knows the steps at which its other runs end
        (DRAWN.format(""), "differ from run to run; seed its random numbers"),
    ],
    ids=["shifted", "smoothed", "shifted covariances", "remembers", "another length", "guesses", "random"],
)
def test_estimates_that_use_the_future_are_refused(
    tmp_path: Path, source: str, what: str, monkeypatch: pytest.MonkeyPatch
):
    recording = short("q1-short-dense", "trajectory.duration=8")
    monkeypatch.setattr(np.random, "default_rng", partial(np.random.default_rng, 0))  # one guess in 4096 is right
    with pytest.raises(UserError, match=rf"^estimator mine: .*{what}"):
        run(tmp_path, source, recording)
