"""Figures of stored results: width, formats, choice of estimators, limits and style."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from slamgauge.compare.cli.main import main
from slamgauge.compare.figures.curves import robust_limits
from slamgauge.compare.figures.plot_style import INCHES, Sheet, Width, printed_on
from slamgauge.compare.figures.publishing import drawings_of
from slamgauge.compare.figures.study_figures import study_drawings
from slamgauge.compare.studies.stored_study import load_study
from tests.reference.result_folders import USER_NAME, WRITE

pytestmark = pytest.mark.slow

KINDS = ("run", "study", "sweep", "budget", "noise", "bench")
NAMES = {"figure", "rays", "nees", "nis", "rmse", "errors", "ratios", "sweep", "budget", "noise", "bench"}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of results by their kind, without figures."""
    out = tmp_path_factory.mktemp("results")
    for kind in KINDS:
        WRITE[kind](out / kind)
    return out


@pytest.mark.parametrize("width", INCHES)
def test_nothing_is_cropped_and_logarithmic_axes_have_few_and_plain_labels(
    results: Path, drawn: dict[str, Figure], width: Width
):
    with printed_on(Sheet(width)):
        for kind in KINDS:
            for draw in drawings_of(results / kind).values():
                draw(results)
    assert set(drawn) == NAMES
    scales = 0
    for name, figure in drawn.items():
        figure.dpi = 72
        figure.draw_without_rendering()
        box, (inches, height) = figure.get_tightbbox(), figure.get_size_inches()
        assert inches == INCHES[width]
        beyond = np.round([-box.x0, box.x1 - inches, -box.y0, box.y1 - height], 3)
        assert (name, (beyond < 0.02).all()) == (name, True), beyond
        for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) if axis.get_scale() == "log"):
            low, high = sorted(axis.get_view_interval())
            ticks = [tick for tick in axis.get_majorticklocs() if low <= tick <= high]
            assert 1 <= len(ticks) <= 9
            assert not [text for text in axis.get_ticklabels(minor=True) if text.get_text()]
            assert not any("$" in axis.get_major_formatter()(tick) for tick in ticks)
            scales += 1
    assert scales >= 4


def labels(figure: Figure) -> set[str]:
    return {label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]}


def test_export_draws_the_chosen_estimators(results: Path, tmp_path: Path, drawn: dict[str, Figure]):
    words = ("export", "figures", str(results / "run"), "--form", "svg", "--out", str(tmp_path / "out"))
    assert main([*words, "--estimators", "causal,ekf"]) == 0
    assert set(drawn) == {"figure", "rays"}
    assert labels(drawn["figure"]) >= {"ekf", "causal"} and USER_NAME not in labels(drawn["figure"])
    for kind, name in (("sweep", "sweep"), ("bench", "bench"), ("study", "nees")):
        drawings_of(results / kind, ["ekf"])[name](tmp_path)
        assert labels(drawn[name]) - {"99.9% band"} == {"ekf"}


def test_numbers_of_the_study_are_drawn(results: Path, tmp_path: Path, drawn: dict[str, Figure]):
    for draw in drawings_of(results / "study").values():
        draw(tmp_path)
    series = load_study(results / "study").runs["ekf"].series
    nees = next(line for line in drawn["nees"].axes[0].lines if line.get_label() == "ekf")
    np.testing.assert_allclose(np.asarray(nees.get_ydata()), series["nees_pose"].mean(axis=0))
    panel = drawn["errors"].axes[0]
    (errors,) = (each for each in panel.collections if isinstance(each, LineCollection))
    np.testing.assert_allclose([segment[:, 1] for segment in errors.get_segments()], series["error_x"])
    low, high = (np.asarray(line.get_ydata()) for line in panel.lines)
    np.testing.assert_allclose([high, -low], np.tile(3 * series["sigma_x"].mean(axis=0), (2, 1)))


@pytest.mark.parametrize(
    ("folder", "options", "message"),
    [
        ("run", "--estimators oc-ekf", "oc-ekf"),
        ("noise", "--estimators ekf", "noise.json has no estimators to choose"),
        ("bench", "--estimators riekf", "riekf"),
        ("", "", "contains no run, study, sweep, budget, noise or bench"),
        *(
            (
                f"damaged/{kind}",
                "",
                f"{kind}.json: written by another version, or changed by hand; move it away, and run",
            )
            for kind in ("noise", "budget", "bench", "sweep")
        ),
    ],
)
def test_refusals(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], folder: str, options: str, message: str
):
    if folder.startswith("damaged"):
        (results / folder).mkdir(parents=True)
        (results / folder / f"{Path(folder).name}.json").write_text("{}")
    assert main(["export", "figures", str(results / folder), "--out", str(tmp_path / "out"), *options.split()]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_have_the_requested_format_and_width_and_no_date(results: Path, tmp_path: Path):
    words = ("export", "figures", str(results / "budget"), "--width", "column", "--out", str(tmp_path))
    assert main([*words]) == 0
    written = (tmp_path / "budget.pdf").read_bytes()
    assert b"/MediaBox [ 0 0 244.8 " in written and b"CreationDate" not in written  # 3.4 in, in points


def test_limits_ignore_a_diverged_estimator_and_name_it(results: Path, tmp_path: Path, drawn: dict[str, Figure]):
    extents = {"a": np.array([1.0, 2.0]), "b": np.array([2.0, 1.0]), "c": np.array([1e6, 2.0])}
    heights, gone = robust_limits(extents)
    assert (heights.tolist(), gone) == ([2.0, 2.0], ["c"])
    assert robust_limits({"exact": np.zeros(1), "too": np.zeros(1), "rounding": np.full(1, 1e-16)})[1] == []
    study = load_study(results / "study")
    runs = study.runs["ekf"]
    wild = {key: 1e4 * rows if key.startswith(("error", "nees", "nis")) else rows for key, rows in runs.series.items()}
    lost = replace(runs, series=wild, figures={**runs.figures, "ate_m": 1e4 * runs.figures["ate_m"]})
    for draw in study_drawings(study.summary, {**study.runs, "ekf": lost}, study.step).values():
        draw(tmp_path)
    for key in ("nees", "rmse", "errors"):
        assert drawn[key].axes[0].get_ylim()[1] < 40
        assert any("ekf exceeds the axes" in axes.get_title() for axes in drawn[key].axes)
    assert drawn["ratios"].axes[0].get_xlim()[1] < 200
    assert "ekf / hindsight, ekf / causal exceed the axes" in drawn["ratios"].axes[0].get_title()


def test_users_can_load_the_style_by_its_name():
    with plt.style.context("slamgauge.paper"):
        assert mpl.rcParams["figure.figsize"] == [INCHES["column"], 2.4]
        colours = [to_rgba(each["color"]) for each in mpl.rcParams["axes.prop_cycle"]]
        assert len({*colours}) == len(colours) == 8
