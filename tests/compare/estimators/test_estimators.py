"""Estimators by name: names, settings of filters, and inputs of graphs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamgauge import dead_reckoning
from slamgauge.compare.estimators.loading import entry_behind, load_estimators
from slamgauge.compare.estimators.registry import FILTERS, GRAPHS, HELP, REGISTRY, entry_of
from slamgauge.compare.estimators.running import run_estimator
from slamgauge.compare.scenarios.scenario import load_scenario
from slamgauge.compare.scenarios.schema import Association
from slamgauge.compare.scenarios.simulation import informed, simulate
from slamgauge.compare.scoring.comparison import compare_estimators
from slamgauge.compare.studies.study_run import run_once
from slamgauge.ekf import FilterSettings, ekf_slam, riekf
from slamgauge.ekf.maps.correction_table import CORRECTIONS
from slamgauge.ekf.settings import Association as FilterAssociation
from slamgauge.ekf.settings import MapManagement
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.graph_baseline import batch, causal
from slamgauge.recording import Recording

from .conftest import short

pytestmark = pytest.mark.slow

SHORT = ["start=sampled", "trajectory.duration=4"]


def same(one: Estimate, other: Estimate) -> bool:
    associations = np.array_equal(np.asarray(one.association), np.asarray(other.association))
    return associations and np.array_equal(one.poses, other.poses)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (None, FilterAssociation()),
        (Association(), FilterAssociation()),
        (Association(method="nearest-neighbour", gate=1.0), FilterAssociation(gate=1.0)),
        (Association(method="jcbb"), FilterAssociation("jcbb", 9.0, MapManagement())),
        (Association(method="jcbb", map_management=False), FilterAssociation("jcbb")),
        (
            Association(method="nearest-neighbour", map_management=True),
            FilterAssociation(map_management=MapManagement()),
        ),
    ],
)
def test_filters_associate_as_in_the_scenario(given: Association | None, meant: FilterAssociation):
    _, recording = simulate(load_scenario("q2-long-dense", SHORT), 0)
    assert recording.landmark is None
    assert same(
        load_estimators(["riekf"], association=given)["riekf"](recording), riekf(recording, FilterSettings(meant))
    )


@pytest.mark.parametrize("graph", GRAPHS)
@pytest.mark.parametrize("filter_name", FILTERS)
def test_a_graph_with_the_associations_of_a_filter(graph: str, filter_name: str):
    _, recording = simulate(load_scenario("q2-short-dense", SHORT), 1)
    found = load_estimators([f"{graph}@{filter_name}", filter_name])
    estimate, own = found[f"{graph}@{filter_name}"](recording), found[filter_name](recording)
    assert estimate.association is not None
    given = estimate.association >= 0
    assert np.array_equal(estimate.association[given], np.asarray(own.association)[given])
    assert given.all() or graph == "robust-batch"


@pytest.mark.parametrize("name", ["causal@", "causal@batch", "ekf@causal", "causal@ekf@ekf", "dead-reckoning@ekf"])
def test_names_that_combine_no_graph_with_a_filter(name: str):
    with pytest.raises(ValueError, match="is not known; write GRAPH@FILTER"):
        load_estimators([name])


def test_only_the_optima_receive_the_true_associations():
    seen: dict[str, Recording] = {}

    def spy(name: str, estimator):
        def run(recording: Recording) -> Estimate:
            seen[name] = recording
            return estimator(recording)

        return run

    truth, recording = simulate(load_scenario("q2-long-dense", SHORT), 0)
    loaded = load_estimators(["ekf", "causal", "batch", "causal@ekf"])
    spies = {name: replace(each, estimate=spy(name, each.estimate)) for name, each in loaded.items()}
    comparison = compare_estimators(truth, recording, spies)
    assert seen["ekf"] is seen["causal@ekf"] is recording
    assert recording.landmark is None
    assert truth.association is not None
    for name, optimum in (("causal", causal), ("batch", batch)):
        assert np.array_equal(np.asarray(seen[name].landmark), truth.association)
        assert same(comparison.estimates[name], optimum(replace(recording, landmark=truth.association)))
    assert comparison.scores["causal"]["wrong_associations"] == 0


def test_an_optimum_is_recognised_by_its_function_not_its_label():
    seen: list[Recording] = []

    def own(recording: Recording) -> Estimate:
        seen.append(recording)
        return riekf(recording)

    truth, recording = simulate(load_scenario("q2-long-dense", SHORT), 0)
    comparison = compare_estimators(truth, recording, {"batch": own, "causal": own, "ekf": ekf_slam})
    assert all(each is recording for each in seen)
    assert all(score["ratio_to_optimum"] is None for score in comparison.scores.values())
    assert all(score["final_distance_to_batch_m"] is None for score in comparison.scores.values())
    comparison = compare_estimators(truth, recording, {"ekf": ekf_slam, "hindsight": batch, "causal": causal})
    assert (
        comparison.scores["causal"]["wrong_associations"] == comparison.scores["hindsight"]["wrong_associations"] == 0
    )
    assert comparison.scores["ekf"]["ratio_to_optimum"] is not None
    assert comparison.scores["ekf"]["final_distance_to_batch_m"] is not None


@pytest.mark.gtsam
def test_every_entry_has_an_estimator_that_is_recognised():
    for name, entry in REGISTRY.items():
        assert entry.name == name
        assert entry_behind(entry.load()) is entry_behind(load_estimators([name])[name]) is entry
    assert {*FILTERS} == {*CORRECTIONS}
    _, recording = simulate(load_scenario("q1-short-dense", SHORT), 0)
    for name, estimator in load_estimators([*REGISTRY]).items():
        assert estimator(recording).kind == REGISTRY[name].kind


def test_a_graph_with_the_associations_of_a_filter_is_no_optimum():
    entry = entry_of("batch@riekf")
    assert (entry.name, entry.kind, entry.role) == ("batch@riekf", "smoothed", "graph")


def test_the_help_text_lists_all_names():
    assert all(name in HELP for name in REGISTRY)
    assert "causal (causal optimum), batch (hindsight), robust-batch, isam2 (GTSAM's iSAM2), gtsam-batch (" in HELP
    assert "; causal@ekf is causal with" in HELP


def test_a_label_may_be_used_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text("def f(recording): ...\n")
    for own, whose in (
        (["ekf=own.py:f"], "ekf is a built-in estimator"),
        (["a=own.py:f", "a=own:f"], "a is given twice"),
    ):
        with pytest.raises(ValueError, match=f"{whose}; write another LABEL= in front"):
            load_estimators(["causal", *own])
    assert [*load_estimators(["causal", "a=own.py:f", "own:f", "own.py:f"])] == ["causal", "a", "own:f", "own.py:f"]


def test_without_true_associations_the_optima_fail():
    truth, recording = simulate(load_scenario("q2-long-dense", SHORT), 0)
    with pytest.raises(ValueError, match="estimator causal: landmark: the graph needs known association"):
        compare_estimators(replace(truth, association=None), recording, load_estimators(["causal"]))


def test_the_optima_of_a_study_receive_the_true_noise():
    names = ["causal", "ekf"]
    wrong, right = (load_scenario(name, SHORT) for name in ("q3-scale-10", "q1-long-sparse"))
    assert informed(wrong) == informed(right)
    (told, misled), (honest, _) = run_once(wrong, 4, names), run_once(right, 4, names)
    assert told.error is None
    assert told.series == honest.series
    assert misled.series != run_once(load_scenario("q3-scale-1", SHORT), 4, names)[1].series


def test_poses_far_from_any_map_are_refused():
    recording = short()
    right = dead_reckoning(recording)
    lost = replace(right, poses=right.poses * 1e200)
    with pytest.raises(UserError, match=r"^estimator mine: has diverged, its pose of step \d+ is \(.*e\+\d{3}.*; mend"):
        run_estimator("mine", lambda _: lost, recording)
