"""Small SVG files: size, peaks of curves, and the unchanged figure."""

from __future__ import annotations

import re

import numpy as np
from matplotlib.figure import Figure

from slamgauge.compare.figures.svg_size import LARGEST, small_svg


def heights(svg: bytes) -> list[float]:
    """Return the distance [pt] of every point of every path from the upper edge."""
    return [float(y) for y in re.findall(rb"[ML] -?[\d.]+ (-?[\d.]+)", svg)]


def test_many_noisy_curves_are_simplified_and_keep_their_peaks():
    rng = np.random.default_rng(0)
    figure = Figure()
    axes = figure.subplots()
    axes.set(xlim=(0, 4000), ylim=(-5, 60))
    time, turn = np.arange(4000.0), np.linspace(0.0, 60.0, 4000)
    axes.plot(time, np.where(time == 1234, 50.0, 0.0))
    for _ in range(10):
        axes.plot(time, rng.uniform(0, 40, len(time)))
        axes.plot(2000 + 1000 * np.cos(turn), 20 + 9 * np.sin(turn) + 0.1 * rng.standard_normal(len(turn)))
    axes.plot(time[:1000], np.zeros(1000), "o")
    before = [line.get_xydata() for line in axes.lines]
    svg = small_svg(figure)
    assert 50_000 < len(svg) < LARGEST
    assert svg.count(b"<use ") >= 1000
    for line, points in zip(axes.lines, before, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), points)
    down = 72 * (figure.get_figheight() - axes.transData.transform((1234, 50.0))[1] / figure.dpi)
    assert min(abs(each - down) for each in heights(svg)) < 0.1


def test_a_small_figure_keeps_every_point():
    figure = Figure()
    figure.subplots().plot(np.arange(500.0), np.random.default_rng(1).standard_normal(500))
    assert len(heights(small_svg(figure))) > 480
