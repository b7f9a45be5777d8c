import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from slamgauge.arrays import Float
from slamgauge.compare.figures.plot_style import STYLES, USER_STYLES, styles
from slamgauge.compare.figures.run_figures import plot_errors, plot_run, save_figure
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.se2 import chain, rotation
from slamgauge.truth import Truth

STEPS = 200
LANDMARKS = np.array([[0.0, -2.0], [4.0, 3.0], [0.0, 10.0]])


def circle() -> tuple[Truth, Recording]:
    """Return a circle of 40 s; landmark 0 is observed at the start and re-observed from 32 s."""
    odometry = np.tile([0.2, 0.0, 0.04], (STEPS, 1))
    poses = chain(np.zeros(3), odometry)
    steps = np.array([0, 50, 80, 160, 161])
    ids = np.array([0, 1, 2, 0, 0])
    recording = Recording(
        stamps=np.linspace(0, 40, STEPS + 1),
        prior_mean=np.zeros(3),
        prior_cov=np.zeros((3, 3)),
        odometry=odometry + np.array([0.0, 0.0, 1e-3]),
        odometry_cov=np.tile(1e-4 * np.eye(3), (STEPS, 1, 1)),
        sensor="range-bearing",
        observation_step=steps,
        observation=np.tile([1.0, 0.0], (5, 1)),
        observation_cov=np.tile(0.01 * np.eye(2), (5, 1, 1)),
        landmark=ids,
    )
    return Truth(poses, np.arange(3), LANDMARKS, ids), recording


TRUTH, RECORDING = circle()
assert TRUTH.poses is not None
POSES = TRUTH.poses


def estimate(offset: Sequence[float], **fields: Any) -> Estimate:
    covs = np.tile(np.diag([0.04, 0.01, 0.0004]), (STEPS + 1, 1, 1))
    given: dict[str, Any] = {
        "kind": "filtered",
        "poses": POSES + np.asarray(offset),
        "pose_covs": covs,
        "landmark_ids": np.arange(3),
        "landmarks": LANDMARKS + 0.1,
        "landmark_covs": np.tile(0.01 * np.eye(2), (3, 1, 1)),
    }
    return Estimate(**(given | fields))


DRIFTING = Estimate("filtered", chain(RECORDING.prior_mean, RECORDING.odometry))


def labels(ax: Axes) -> list[str]:
    return ax.get_legend_handles_labels()[1]


def ellipses(ax: Axes) -> list[EllipseCollection]:
    return [each for each in ax.collections if isinstance(each, EllipseCollection)]


def curve(ax: Axes, label: str) -> Float:
    return next(np.asarray(line.get_xydata()) for line in ax.lines if line.get_label() == label)


def map_of(estimates: Mapping[str, Estimate], truth: Truth | None = TRUTH, recording: Recording = RECORDING) -> Axes:
    ax = Figure().subplots()
    plot_run(ax, truth, recording, estimates)
    return ax


def panels_of(
    estimates: Mapping[str, Estimate],
    truth: Truth | None = TRUTH,
    recording: Recording = RECORDING,
) -> list[Axes]:
    axes: list[Axes] = list(Figure().subplots(3))
    plot_errors(axes, truth, recording, estimates)
    return axes


# --- styles ------------------------------------------------------------------------------------


def test_colours_and_dashes_are_all_distinct() -> None:
    everyone = [*STYLES.values(), *USER_STYLES]
    assert len({style.color for style in everyone}) == len(everyone)
    assert len({style.dashes for style in everyone}) == len(everyone)


def test_user_estimators_do_not_change_the_style_of_built_in_ones() -> None:
    chosen = styles(["a:b", "ekf", "c:d"])
    assert chosen["ekf"] == STYLES["ekf"]
    assert (chosen["a:b"], chosen["c:d"]) == USER_STYLES[:2]


# --- the map -----------------------------------------------------------------------------------


def test_the_map_shows_paths_landmarks_and_marks() -> None:
    ax = map_of({"ekf": estimate([0.1, 0, 0])})
    assert labels(ax) == [
        "truth",
        "dead-reckoning",
        "ekf",
        "true landmark",
        "loop closures",
        "start",
        "mapped landmark",
        "3σ ellipse",
    ]
    assert np.array_equal(curve(ax, "truth"), POSES[:, :2])
    assert np.array_equal(curve(ax, "loop closures"), POSES[160:161, :2])
    assert curve(ax, "dead-reckoning") == pytest.approx(DRIFTING.poses[:, :2])
    assert ax.get_aspect() == 1
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
    assert ax.get_legend() is not None


@pytest.mark.parametrize("height", [2.0, 6.0])
def test_the_legend_does_not_overlap_the_axis_label(height: float) -> None:
    figure = Figure(figsize=(3.4, height))
    ax = figure.subplots()
    plot_run(ax, *circle(), {})
    figure.draw_without_rendering()
    legend = ax.get_legend()
    assert legend is not None
    gap = ax.xaxis.label.get_window_extent().y0 - legend.get_texts()[0].get_window_extent().y1
    assert 0.0 < gap < 0.2 * figure.dpi


def test_ellipses_have_three_sigma_axes_along_the_covariance() -> None:
    turn = rotation(0.5)
    covs = np.tile(turn @ np.diag([4.0, 1.0]) @ turn.T, (3, 1, 1))
    ax = map_of({"ekf": estimate([0, 0, 0], pose_covs=None, landmark_covs=covs)})
    (collection,) = ellipses(ax)
    assert collection.get_widths() == pytest.approx([12, 12, 12])
    assert collection.get_heights() == pytest.approx([6, 6, 6])
    assert np.asarray(collection.get_angles()) % 180 == pytest.approx(np.degrees([0.5, 0.5, 0.5]))
    assert np.asarray(collection.get_offsets()) == pytest.approx(LANDMARKS + 0.1)


def test_crowded_maps_have_landmark_ellipses_of_the_first_estimate_only() -> None:
    many = {
        "pose_covs": None,
        "landmark_ids": np.arange(100),
        "landmarks": np.zeros((100, 2)),
        "landmark_covs": np.tile(np.eye(2), (100, 1, 1)),
    }
    estimates = {"ekf": estimate([0, 0, 0], **many), "riekf": estimate([0, 0, 0], **many)}
    assert len(ellipses(map_of(estimates))) == 1
    few = {name: estimate([0, 0, 0], pose_covs=None) for name in estimates}
    assert len(ellipses(map_of(few))) == 2


def test_limits_of_the_map_ignore_drifted_dead_reckoning() -> None:
    drifted = Estimate("filtered", 100 * DRIFTING.poses)
    ax = map_of({"dead-reckoning": drifted, "ekf": estimate([0, 0, 0])})
    assert ax.get_xlim()[1] - ax.get_xlim()[0] < 30
    assert ax.get_title() == "dead reckoning exceeds the axes"


def test_a_map_without_truth_or_estimates_shows_the_odometry() -> None:
    ax = map_of({}, truth=None)
    assert labels(ax) == ["dead-reckoning", "loop closures", "start", "mapped landmark"]
    assert ax.get_title() == ""


# --- the errors --------------------------------------------------------------------------------


def test_errors_are_drawn_in_metres_and_degrees() -> None:
    panels = panels_of({"ekf": estimate([0.1, -0.2, np.radians(2)])})
    for panel, error, bound in zip(panels, [0.1, -0.2, 2.0], [0.6, 0.3, np.degrees(0.06)], strict=True):
        assert curve(panel, "ekf")[:, 0] == pytest.approx(RECORDING.stamps)
        assert curve(panel, "ekf")[:, 1] == pytest.approx(np.full(STEPS + 1, error))
        drawn = [np.asarray(line.get_ydata())[-1] for line in panel.lines]
        assert [min(drawn), max(drawn)] == pytest.approx([-bound, bound])
        assert panel.get_ylim()[0] == -panel.get_ylim()[1]
        assert panel.get_ylim()[1] >= bound
    assert [panel.get_ylabel() for panel in panels] == ["x [m]", "y [m]", "heading [°]"]
    assert panels[0].get_title() == "error and ±3σ"
    assert panels[2].get_xlabel() == "time [s]; ticks: loop closures"


def test_only_the_first_band_is_filled() -> None:
    panels = panels_of({name: estimate([0, 0, 0]) for name in ("riekf", "ekf", "causal")})
    (filled,) = (each for each in panels[0].collections if not isinstance(each, LineCollection))
    assert to_hex(np.asarray(filled.get_facecolor())[0]) == STYLES["riekf"].color.lower()
    assert len(panels[0].lines) == 3 * 3 + 1  # error and two bounds each, zero


def test_errors_of_dead_reckoning_are_drawn_only_without_other_estimates() -> None:
    alone = panels_of({"dead-reckoning": DRIFTING})
    assert labels(alone[0]) == ["dead-reckoning"]
    both = panels_of({"dead-reckoning": DRIFTING, "ekf": estimate([0, 0, 0])})
    assert labels(both[0]) == ["ekf"]
    assert both[0].get_title() == "error and ±3σ (dead reckoning not drawn)"


@pytest.mark.parametrize(("best", "others"), [("batch", ["ekf", "causal"]), ("causal", ["ekf"])])
def test_without_truth_differences_to_the_optimum_are_drawn(best: str, others: list[str]) -> None:
    estimates = {name: estimate([0.3, 0, 0]) for name in others} | {best: estimate([0.1, 0, 0])}
    panels = panels_of(estimates, truth=None)
    assert labels(panels[0]) == others
    assert curve(panels[0], "ekf")[:, 1] == pytest.approx(np.full(STEPS + 1, 0.2))
    assert panels[0].get_title() == f"difference to {best} and ±3σ"


def test_without_truth_and_optimum_only_bounds_are_drawn() -> None:
    panels = panels_of({"ekf": estimate([0, 0, 0])}, truth=None)
    assert np.isnan(curve(panels[0], "ekf")[:, 1]).all()
    assert panels[0].get_title() == "±3σ only: no truth, no optimum"


def test_an_optimum_in_doubt_is_named_and_marked(tmp_path: Path, drawn: dict[str, Figure]) -> None:
    for check, is_marked in ((0.01, False), (0.31, True)):
        optimum = estimate([0, 0, 0], optimum_check=check)
        save_figure(tmp_path, None, RECORDING, {"causal": optimum, "ekf": estimate([0.1, 0, 0])}, "a title")
        title, panel = drawn["figure"].get_suptitle(), drawn["figure"].axes[1].get_title()
        assert ("causal is 0.31 sigma from the optimum at a checked step" in title) == is_marked
        assert ("difference to causal? and" in panel) == is_marked


# --- the files ---------------------------------------------------------------------------------


def test_files_of_the_figure_are_reproducible_and_names_with_dollars_are_not_formulas(tmp_path: Path) -> None:
    estimates = {"ekf": estimate([0.1, 0, 0]), r"$\frac$": estimate([0, 0.1, 0])}
    written: list[tuple[bytes, bytes]] = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        save_figure(tmp_path / name, TRUTH, RECORDING, estimates, r"cost $\frac$ of $")
        png, svg = ((tmp_path / name / f"figure.{form}").read_bytes() for form in ("png", "svg"))
        written.append((png, svg))
    assert written[0] == written[1]
    png, svg = written[0]
    assert (int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")) == (1400, 920)  # 7.0 x 4.6 in
    assert ElementTree.fromstring(svg).attrib["width"] == "504pt"
    assert b">cost $\\frac$ of $</text>" in svg


def test_only_some_of_many_loop_closures_are_marked() -> None:
    """Steps of 10 s and one landmark that is observed at every second step."""
    steps = np.arange(0, STEPS, 2)
    recording = dataclasses.replace(
        RECORDING,
        stamps=np.linspace(0.0, 10.0 * STEPS, STEPS + 1),
        observation_step=steps,
        observation=np.tile([1.0, 0.0], (len(steps), 1)),
        observation_cov=np.tile(0.01 * np.eye(2), (len(steps), 1, 1)),
        landmark=np.zeros_like(steps),
    )
    panels = panels_of({"ekf": estimate([0, 0, 0])}, recording=recording)
    ticks = [each for each in panels[0].collections if isinstance(each, LineCollection)]
    assert [len(each.get_segments()) for each in ticks] == [50]  # every second one of 99
    assert panels[2].get_xlabel() == "time [s]; ticks: 1 in 2 loop closures"
    assert "1 in 2 loop closures" in labels(map_of({}, recording=recording))


def test_error_panels_ignore_a_diverged_estimate_and_name_it():
    near, lost = estimate([0.01, 0.0, 0.0]), estimate([40.0, 0.0, 0.0])
    panels = panels_of({"near": near, "lost": lost, "too": near})
    assert panels[0].get_title() == "error and ±3σ (lost exceeds the axes)"
    assert panels[0].get_ylim() == pytest.approx((-0.66, 0.66))  # 3 sigma are 0.6 m
