import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import Collection, EllipseCollection, LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from slamgauge.arrays import Float
from slamgauge.compare.figures import plot_style
from slamgauge.compare.figures.plot_style import KNOWN, PRINT, USER_STYLES, styles
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


def estimate(truth: Truth, offset: Sequence[float], **fields: Any) -> Estimate:
    covs = np.tile(np.diag([0.04, 0.01, 0.0004]), (STEPS + 1, 1, 1))
    assert truth.poses is not None
    given: dict[str, Any] = {
        "kind": "filtered",
        "poses": truth.poses + np.asarray(offset),
        "pose_covs": covs,
        "landmark_ids": np.arange(3),
        "landmarks": LANDMARKS + 0.1,
        "landmark_covs": np.tile(0.01 * np.eye(2), (3, 1, 1)),
    }
    return Estimate(**(given | fields))


def drifting(recording: Recording) -> Estimate:
    return Estimate("filtered", chain(recording.prior_mean, recording.odometry))


def labels(ax: Axes) -> list[str]:
    return ax.get_legend_handles_labels()[1]


def ellipses(ax: Axes) -> list[EllipseCollection]:
    return [each for each in ax.collections if isinstance(each, EllipseCollection)]


def curve(ax: Axes, label: str) -> Float:
    return next(np.asarray(line.get_xydata()) for line in ax.lines if line.get_label() == label)


def map_of(truth: Truth | None, recording: Recording, estimates: dict[str, Estimate]) -> Axes:
    ax = Figure().subplots()
    plot_run(ax, truth, recording, estimates)
    return ax


def panels_of(truth: Truth | None, recording: Recording, estimates: dict[str, Estimate]) -> list[Axes]:
    axes: list[Axes] = list(Figure().subplots(3))
    plot_errors(axes, truth, recording, estimates)
    return axes


# --- styles ------------------------------------------------------------------------------------


def test_colours_and_dashes_are_all_distinct() -> None:
    everyone = [*KNOWN.values(), *USER_STYLES]
    assert len({style.color for style in everyone}) == len(everyone)
    assert len({style.dashes for style in everyone}) == len(everyone)


def test_user_estimators_do_not_change_the_style_of_built_in_ones() -> None:
    chosen = styles(["a:b", "ekf", "c:d"])
    assert chosen["ekf"] == KNOWN["ekf"]
    assert (chosen["a:b"], chosen["c:d"]) == USER_STYLES[:2]


# --- the map -----------------------------------------------------------------------------------


def test_the_map_shows_paths_landmarks_and_marks() -> None:
    truth, recording = circle()
    ax = map_of(truth, recording, {"ekf": estimate(truth, [0.1, 0, 0])})
    assert labels(ax) == [
        "truth",
        "dead-reckoning",
        "ekf",
        "true landmark",
        "loop closure",
        "start",
        "mapped landmark",
        "3σ ellipse",
    ]
    assert truth.poses is not None
    assert np.array_equal(curve(ax, "truth"), truth.poses[:, :2])
    assert np.array_equal(curve(ax, "loop closure"), truth.poses[160:161, :2])
    assert curve(ax, "dead-reckoning") == pytest.approx(drifting(recording).poses[:, :2])
    assert ax.get_aspect() == 1
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
    assert ax.get_legend() is not None


def test_the_label_of_panels_in_a_row_is_within_the_figure() -> None:
    figure = Figure(figsize=(7.0, 2.6), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, 4))[1:]
    truth, recording = circle()
    plot_errors(panels, truth, recording, {"ekf": estimate(truth, [0.1, 0, 0])})
    figure.draw_without_rendering()
    assert panels[2].xaxis.label.get_window_extent().x1 <= figure.bbox.x1


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
    truth, recording = circle()
    turn = rotation(0.5)
    covs = np.tile(turn @ np.diag([4.0, 1.0]) @ turn.T, (3, 1, 1))
    ax = map_of(truth, recording, {"ekf": estimate(truth, [0, 0, 0], pose_covs=None, landmark_covs=covs)})
    (collection,) = ellipses(ax)
    assert collection.get_widths() == pytest.approx([12, 12, 12])
    assert collection.get_heights() == pytest.approx([6, 6, 6])
    assert np.asarray(collection.get_angles()) % 180 == pytest.approx(np.degrees([0.5, 0.5, 0.5]))
    assert np.asarray(collection.get_offsets()) == pytest.approx(LANDMARKS + 0.1)


def test_crowded_maps_have_landmark_ellipses_of_the_first_estimate_only() -> None:
    truth, recording = circle()
    many = {
        "pose_covs": None,
        "landmark_ids": np.arange(100),
        "landmarks": np.zeros((100, 2)),
        "landmark_covs": np.tile(np.eye(2), (100, 1, 1)),
    }
    estimates = {"ekf": estimate(truth, [0, 0, 0], **many), "riekf": estimate(truth, [0, 0, 0], **many)}
    assert len(ellipses(map_of(truth, recording, estimates))) == 1
    few = {name: estimate(truth, [0, 0, 0], pose_covs=None) for name in estimates}
    assert len(ellipses(map_of(truth, recording, few))) == 2


def test_limits_of_the_map_ignore_drifted_dead_reckoning() -> None:
    truth, recording = circle()
    drifted = Estimate("filtered", 100 * drifting(recording).poses)
    ax = map_of(truth, recording, {"dead-reckoning": drifted, "ekf": estimate(truth, [0, 0, 0])})
    assert ax.get_xlim()[1] - ax.get_xlim()[0] < 30
    assert ax.get_title() == "dead reckoning exceeds the axes"


def test_a_map_without_truth_or_estimates_shows_the_odometry() -> None:
    _, recording = circle()
    ax = map_of(None, recording, {})
    assert labels(ax) == ["dead-reckoning", "loop closure", "start", "mapped landmark"]
    assert ax.get_title() == ""


# --- the errors --------------------------------------------------------------------------------


def test_errors_are_drawn_in_metres_and_degrees() -> None:
    truth, recording = circle()
    panels = panels_of(truth, recording, {"ekf": estimate(truth, [0.1, -0.2, np.radians(2)])})
    for panel, error, bound in zip(panels, [0.1, -0.2, 2.0], [0.6, 0.3, np.degrees(0.06)], strict=True):
        assert curve(panel, "ekf")[:, 0] == pytest.approx(recording.stamps)
        assert curve(panel, "ekf")[:, 1] == pytest.approx(np.full(STEPS + 1, error))
        drawn = [np.asarray(line.get_ydata())[-1] for line in panel.lines]
        assert bound == pytest.approx(max(drawn))
        assert panel.get_ylim()[0] == -panel.get_ylim()[1]
        assert panel.get_ylim()[1] >= bound
    assert [panel.get_ylabel() for panel in panels] == ["x [m]", "y [m]", "heading [°]"]
    assert panels[0].get_title() == "error and ±3σ"
    assert panels[2].get_xlabel() == "time [s]; ticks: loop closures"


def test_only_the_first_band_is_filled() -> None:
    truth, recording = circle()
    panels = panels_of(truth, recording, {name: estimate(truth, [0, 0, 0]) for name in ("ekf", "riekf", "causal")})
    filled: list[Collection] = [each for each in panels[0].collections if each.get_alpha() == 0.15]
    assert len(filled) == 1
    assert len(panels[0].lines) == 3 * 3 + 1  # error and two bounds each, zero


def test_errors_of_dead_reckoning_are_drawn_only_without_other_estimates() -> None:
    truth, recording = circle()
    alone = panels_of(truth, recording, {"dead-reckoning": drifting(recording)})
    assert labels(alone[0]) == ["dead-reckoning"]
    both = panels_of(truth, recording, {"dead-reckoning": drifting(recording), "ekf": estimate(truth, [0, 0, 0])})
    assert labels(both[0]) == ["ekf"]
    assert both[0].get_title() == "error and ±3σ (dead reckoning not drawn)"


@pytest.mark.parametrize(("best", "others"), [("batch", ["ekf", "causal"]), ("causal", ["ekf"])])
def test_without_truth_differences_to_the_optimum_are_drawn(best: str, others: list[str]) -> None:
    truth, recording = circle()
    estimates = {name: estimate(truth, [0.3, 0, 0]) for name in others} | {best: estimate(truth, [0.1, 0, 0])}
    panels = panels_of(None, recording, estimates)
    assert labels(panels[0]) == others
    assert curve(panels[0], "ekf")[:, 1] == pytest.approx(np.full(STEPS + 1, 0.2))
    assert panels[0].get_title() == f"difference to {best} and ±3σ"


def test_without_truth_and_optimum_only_bounds_are_drawn() -> None:
    truth, recording = circle()
    panels = panels_of(None, recording, {"ekf": estimate(truth, [0, 0, 0])})
    assert np.isnan(curve(panels[0], "ekf")[:, 1]).all()
    assert panels[0].get_title() == "±3σ only: no truth, no optimum"


# --- the files ---------------------------------------------------------------------------------


def test_files_of_the_figure_are_reproducible(tmp_path: Path) -> None:
    truth, recording = circle()
    estimates = {"ekf": estimate(truth, [0.1, 0, 0]), "my.module:filter": estimate(truth, [0, 0.1, 0])}
    contents: list[tuple[bytes, bytes]] = []
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        save_figure(folder, truth, recording, estimates, "a title")
        contents.append(((folder / "figure.png").read_bytes(), (folder / "figure.svg").read_bytes()))
    assert contents[0] == contents[1]
    png, svg = contents[0]
    assert (int.from_bytes(png[16:20], "big"), int.from_bytes(png[20:24], "big")) == (1400, 920)  # 7.0 x 4.6 in
    root = ElementTree.fromstring(svg)
    assert root.attrib["width"] == "504pt"
    assert b"<dc:date>" not in svg
    assert b"<image" not in svg  # nothing is rasterised
    assert b">a title</text>" in svg


def test_names_with_dollar_signs_are_not_formulas(tmp_path: Path):
    truth, recording = circle()
    save_figure(tmp_path, truth, recording, {r"$\frac$": estimate(truth, [0, 0, 0])}, r"cost $\frac$ of $")
    ElementTree.parse(tmp_path / "figure.svg")


def with_many_closures(recording: Recording) -> Recording:
    """Return the recording with steps of 10 s and one landmark that is observed at every second step."""
    steps = np.arange(0, STEPS, 2)
    return dataclasses.replace(
        recording,
        stamps=10.0 * np.arange(STEPS + 1),
        observation_step=steps,
        observation=np.tile([1.0, 0.0], (len(steps), 1)),
        observation_cov=np.tile(0.01 * np.eye(2), (len(steps), 1, 1)),
        landmark=np.zeros_like(steps),
    )


def test_only_some_of_many_loop_closures_are_marked() -> None:
    truth, recording = circle()
    recording = with_many_closures(recording)
    panels = panels_of(truth, recording, {"ekf": estimate(truth, [0, 0, 0])})
    ticks = [each for each in panels[0].collections if isinstance(each, LineCollection)]
    assert [len(each.get_segments()) for each in ticks] == [50]  # every second one of 99
    assert panels[2].get_xlabel() == "time [s]; ticks: 1 in 2 loop closures"
    assert "1 in 2 loop closures" in labels(map_of(truth, recording, {}))


@pytest.mark.parametrize("optimum", ["batch", "causal", "ekf"])
def test_titles_of_a_figure_without_truth_are_not_cropped(
    optimum: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, recording = circle()
    written: list[Figure] = []

    def keep(figure: Figure, _: Path) -> None:
        written.append(figure)

    monkeypatch.setattr(plot_style, "save_printed", keep)
    estimates = {"dead-reckoning": drifting(recording), "riekf": estimate(truth, [0, 0, 0])}
    save_figure(tmp_path, None, recording, estimates | {optimum: estimate(truth, [0.1, 0, 0])}, "a run")
    (figure,) = written
    with mpl.rc_context(PRINT):
        figure.draw_without_rendering()
    width = figure.bbox.width
    for ax in figure.axes:
        extent = ax.title.get_window_extent()
        assert 0.0 <= extent.x0 <= extent.x1 <= width, ax.get_title()


def test_error_panels_ignore_a_diverged_estimate_and_name_it():
    truth, recording = circle()
    assert truth.poses is not None
    near, lost = estimate(truth, [0.01, 0.0, 0.0]), estimate(truth, [40.0, 0.0, 0.0])
    panels = Figure().subplots(3)
    plot_errors(panels, truth, recording, {"near": near, "lost": lost, "too": near}, band="too")
    assert panels[0].get_title() == "error and ±3σ (lost exceeds the axes)"
    assert panels[0].get_ylim() == pytest.approx((-0.66, 0.66))  # 3 sigma are 0.6 m
    band = next(each for each in panels[0].collections if not isinstance(each, LineCollection))
    chosen = styles(["near", "lost", "too"])["too"].color
    assert to_hex(np.asarray(band.get_facecolor())[0]) == chosen.lower()
