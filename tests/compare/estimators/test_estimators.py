"""Estimators by name: names, settings of filters, and inputs of graphs, also if the true associations are unknown."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import dead_reckoning
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.loading import entry_behind, load_estimators
from slamgauge.compare.estimators.registry import FILTERS, GRAPHS, HELP, REGISTRY, entry_of
from slamgauge.compare.estimators.requests import Chosen
from slamgauge.compare.estimators.running import SideBySide, run_estimator, run_side_by_side
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.schema import Association
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.comparison import compare_estimators
from slamgauge.compare.storage.files import save
from slamgauge.compare.studies.study_run import run_once
from slamgauge.ekf import FilterSettings, ekf_slam, riekf
from slamgauge.ekf.maps.correction_table import CORRECTIONS
from slamgauge.ekf.settings import Association as FilterAssociation
from slamgauge.ekf.settings import MapManagement
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, Estimator
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording

from .conftest import short

pytestmark = pytest.mark.slow

SHORT = ["start=sampled", "trajectory.duration=4"]
TRUTH, UNKNOWN = simulate(load_scenario("q2-long-dense", SHORT), 0)  # a recording without ids


def same(one: Estimate, other: Estimate) -> bool:
    associations = np.array_equal(np.asarray(one.association), np.asarray(other.association))
    return associations and np.array_equal(one.poses, other.poses)


# --- names and settings ------------------------------------------------------------------------


@pytest.mark.gtsam
def test_every_entry_has_an_estimator_that_is_recognised():
    for name, entry in REGISTRY.items():
        assert entry.name == name
        assert entry_behind(entry.load()) is entry_behind(load_estimators([name])[name]) is entry
    assert {*FILTERS} == {*CORRECTIONS}
    for name, estimator in load_estimators([*REGISTRY]).items():
        assert estimator(short()).kind == REGISTRY[name].kind


def test_the_help_text_lists_all_names():
    assert all(name in HELP for name in REGISTRY)
    assert "causal (causal optimum), batch (hindsight), robust-batch, isam2 (GTSAM's iSAM2), gtsam-batch (" in HELP
    entry = entry_of("batch@riekf")
    assert (entry.name, entry.kind, entry.role) == ("batch@riekf", "smoothed", "graph")  # not an optimum


@pytest.mark.parametrize("name", ["causal@", "causal@batch", "ekf@causal", "causal@ekf@ekf", "dead-reckoning@ekf"])
def test_names_that_combine_no_graph_with_a_filter(name: str):
    with pytest.raises(ValueError, match="is not known; write GRAPH@FILTER"):
        load_estimators([name])


@pytest.mark.parametrize(
    ("chosen", "why"),
    [
        (["causal", "ekf=own.py:f"], "ekf is a built-in estimator; write another LABEL= in front"),
        (["causal", "a=own.py:f", "a=own:f"], "a is given twice; write another LABEL= in front"),
        ({"ekf": dead_reckoning}, "ekf is a built-in estimator; write another"),
        ({"a/b": ekf_slam}, "label 'a/b' names files of results; give a short word"),
    ],
)
def test_labels_that_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chosen: Chosen, why: str):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text("def f(recording): ...\n")
    with pytest.raises(ValueError, match=why):
        load_estimators(chosen)
    assert [*load_estimators(["causal", "a=own.py:f", "own:f", "own.py:f"])] == ["causal", "a", "own:f", "own.py:f"]


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (None, FilterAssociation()),
        (Association(), FilterAssociation()),
        (Association(method="nearest-neighbour", gate=1.0), FilterAssociation(gate=1.0)),
        (Association(method="jcbb"), FilterAssociation("jcbb", 9.0, MapManagement())),
        (Association(method="jcbb", map_management=False), FilterAssociation("jcbb")),
    ],
)
def test_filters_associate_as_in_the_scenario(given: Association | None, meant: FilterAssociation):
    assert same(load_estimators(["riekf"], given)["riekf"](UNKNOWN), riekf(UNKNOWN, FilterSettings(meant)))


def test_poses_far_from_any_map_are_refused():
    right = dead_reckoning(short())
    lost = replace(right, poses=right.poses * 1e200)
    with pytest.raises(UserError, match=r"^estimator mine: has diverged, its pose of step \d+ is \(.*e\+\d{3}.*; mend"):
        run_estimator("mine", lambda _: lost, short())


# --- inputs of graphs --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("graph", "filter_name"), [*((graph, "ekf") for graph in GRAPHS), *(("causal", name) for name in FILTERS)]
)
def test_a_graph_with_the_associations_of_a_filter(graph: str, filter_name: str):
    recording = simulate(load_scenario("q2-short-dense", SHORT), 1)[1]
    found = load_estimators([f"{graph}@{filter_name}", filter_name])
    estimate, own = found[f"{graph}@{filter_name}"](recording), found[filter_name](recording)
    assert estimate.association is not None
    given = estimate.association >= 0
    assert np.array_equal(estimate.association[given], np.asarray(own.association)[given])
    assert given.all() or graph == "robust-batch"


def test_only_the_optima_receive_the_true_associations():
    seen: dict[str, Recording] = {}

    def spy(name: str, estimator: Estimator) -> Estimator:
        return lambda recording: estimator(seen.setdefault(name, recording))

    loaded = load_estimators(["ekf", "causal", "batch", "causal@ekf"])
    spies = {name: replace(each, estimate=spy(name, each.estimate)) for name, each in loaded.items()}
    comparison = compare_estimators(TRUTH, UNKNOWN, spies)
    assert seen["ekf"] is seen["causal@ekf"] is UNKNOWN
    for name, optimum in (("causal", causal), ("batch", batch)):
        assert np.array_equal(np.asarray(seen[name].landmark), np.asarray(TRUTH.association))
        assert same(comparison.estimates[name], optimum(replace(UNKNOWN, landmark=TRUTH.association)))
    assert comparison.scores["causal"]["wrong_associations"] == 0


def test_an_optimum_is_recognised_by_its_function_not_its_label():
    own = {"batch": lambda recording: riekf(recording), "causal": lambda recording: riekf(recording)}
    scores = compare_estimators(TRUTH, UNKNOWN, {**own, "ekf": ekf_slam}).scores
    assert {score["ratio_to_optimum"] for score in scores.values()} == {None}
    assert scores["batch"]["wrong_associations"] == scores["causal"]["wrong_associations"] is not None
    scores = compare_estimators(TRUTH, UNKNOWN, {"ekf": ekf_slam, "hindsight": batch, "causal": causal}).scores
    assert scores["causal"]["wrong_associations"] == scores["hindsight"]["wrong_associations"] == 0
    assert scores["ekf"]["ratio_to_optimum"] is not None


def test_the_optima_of_a_study_receive_the_true_noise():
    wrong, other, right = (load_scenario(name, SHORT) for name in ("q3-scale-10", "q3-scale-1", "q1-long-sparse"))
    assert informed(wrong) == informed(right)
    told, honest = (run_once(each, 4, ["causal"])[0] for each in (wrong, right))
    assert (told.error, told.series) == (None, honest.series)
    assert run_once(wrong, 4, ["ekf"])[0].series != run_once(other, 4, ["ekf"])[0].series


# --- optima if the true associations are unknown -----------------------------------------------


def ran(*names: str, **more: Estimator) -> SideBySide:
    return run_side_by_side({**more, **load_estimators([*names])}, UNKNOWN, UNKNOWN)


def test_the_optima_use_the_associations_of_the_first_estimator():
    found = ran("causal", "dead-reckoning", "riekf", "ekf", "batch")
    assert [*found.estimates] == ["dead-reckoning", "riekf", "ekf", "causal@riekf", "batch@riekf"]
    assert found.optima == {"filtered": "causal@riekf", "smoothed": "batch@riekf"}
    assert (found.failures, found.stand_ins) == ({}, ["causal@riekf", "batch@riekf"])
    assert same(found.estimates["causal@riekf"], load_estimators(["causal@riekf"])["causal@riekf"](UNKNOWN))
    assert ran("causal", mine=lambda recording: ekf_slam(recording)).optima == {"filtered": "causal@mine"}


def test_a_requested_graph_with_associations_is_the_optimum():
    assert ran("ekf", "causal@riekf", "robust-batch@ekf").optima == {"filtered": "causal@riekf"}
    twice = ran("ekf", "causal", "causal@ekf")
    assert (twice.optima, [*twice.estimates]) == ({"filtered": "causal@ekf"}, ["ekf", "causal@ekf"])


def test_without_any_associations_the_optima_fail_and_true_ones_are_used_if_known():
    found = ran("dead-reckoning", "batch")
    assert ([*found.estimates], found.stand_ins) == (["dead-reckoning"], [])
    assert "needs known association" in found.failures["batch"]
    assert TRUTH.association is not None
    known = UNKNOWN.associated(TRUTH.association)
    found = run_side_by_side(load_estimators(["ekf", "causal", "causal@ekf"]), UNKNOWN, known)
    assert (found.optima, found.stand_ins) == ({"filtered": "causal"}, [])


def test_a_failure_of_batch_leaves_other_results(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    save(tmp_path / "recording.npz", UNKNOWN)
    words = ["evaluate", str(tmp_path / "recording.npz"), "--estimators", "ekf,causal,batch"]
    assert main(words) == 0
    assert "compared with causal@ekf and batch@ekf, with associations right or wrong" in capsys.readouterr().out

    def refuses(*_: object, **__: object) -> Estimate:
        raise UserError("motion 3: undetermined")

    monkeypatch.setattr("slamgauge.graph_baseline.batch", refuses)
    assert main(words) == 1
    out = capsys.readouterr().out
    assert re.search(r"^batch@ekf +failed", out, re.MULTILINE)
    assert "estimator batch@ekf: motion 3: undetermined" in out
    assert "compared with causal@ekf, with" in out
