"""Variants of one good graph: each is read as the graph, or refused or warned of in a line."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import redirect_stderr
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.g2o_writer import write_g2o
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.plausibility import examine
from slamgauge.errors import UserError
from tests.compare.datasets.test_import_variants import DEGREE, GOOD, READ, written

Words = Callable[[list[str]], list[str]]
Change = Callable[[str], str]


def each(tag: str, change: Words) -> Change:
    """Change the words of the lines of a tag."""

    def changed(line: str) -> str:
        words = line.split()
        return " ".join(change(words)) if words and words[0] == tag else line

    return lambda graph: "".join(f"{changed(line)}\n" for line in graph.splitlines())


def scaled(tag: str, at: int, factor: float) -> Change:
    return each(tag, lambda words: [*words[:at], repr(float(words[at]) * factor), *words[at + 1 :]])


def exchanged(tag: str, one: int, other: int) -> Change:
    def change(words: list[str]) -> list[str]:
        words[one], words[other] = words[other], words[one]
        return words

    return each(tag, change)


def with_keys(letters: str) -> Change:
    """Write the ids of poses and landmarks as keys of GTSAM."""
    pose, landmark = (ord(letter) << 56 for letter in letters)

    def changed(line: str) -> str:
        tag, *words = line.split()
        firsts = {"VERTEX_XY": (landmark,), "EDGE_SE2": (pose, pose), "BR": (pose, landmark)}.get(tag, (pose,))
        keys = [str(first + int(word)) for first, word in zip(firsts, words, strict=False)]
        return " ".join([tag, *keys, *words[len(keys) :]])

    return lambda graph: "".join(f"{changed(line)}\n" for line in graph.splitlines())


def inverted(words: list[str]) -> list[str]:
    """Write variances instead of information."""
    diagonal = {6, 9, 11}
    return [repr(1.0 / float(word)) if at in diagonal else word for at, word in enumerate(words)]


VARIANTS: dict[str, tuple[Change, str]] = {
    "as it is": (str, READ),
    "line ends of Windows": (lambda graph: graph.replace("\n", "\r\n"), READ),
    "byte order mark": (lambda graph: "\ufeff" + graph, READ),
    "remarks and blank lines": (lambda graph: "# a graph\n\n" + graph.replace("FIX", "\nFIX") + "\n\n", READ),
    "tabs": (lambda graph: graph.replace(" ", "\t"), READ),
    "lines from the last to the first": (lambda graph: "\n".join([*graph.splitlines()[::-1], ""]), READ),
    "landmarks without vertices": (each("VERTEX_XY", lambda _: []), READ),
    "keys of GTSAM": (with_keys("xl"), "l1 has the id 1001"),
    "keys of GTSAM for landmarks only": (with_keys("\0l"), "l1 has the id 1001"),
    "bearings in degrees": (scaled("BR", 3, DEGREE), "more than a full turn"),
    "clockwise bearings": (scaled("BR", 3, -1.0), "angles in opposite directions"),
    "bearing and range exchanged": (exchanged("BR", 3, 4), "a range < 0"),
    "ranges in mm": (scaled("BR", 4, 1e3), "observed lengths are 1000 times too large"),
    "turns in degrees": (scaled("EDGE_SE2", 5, DEGREE), "turns are in degrees, read as radians"),
    "clockwise turns": (scaled("EDGE_SE2", 5, -1.0), "angles in opposite directions"),
    "motions in mm": (scaled("EDGE_SE2", 3, 1e3), "distances of the odometry are 1000 times too large"),
    "variances instead of information": (each("EDGE_SE2", inverted), "standard deviation of a step"),
    "sigmas 100 times too small": (each("BR", lambda words: [*words[:5], "2e-4", "5e-4"]), "`slamgauge noise`"),
    "poses instead of motions": (
        each("EDGE_SE2", lambda words: [*words[:3], repr(0.05 * int(words[2])), *words[4:]]),
        "agree with one place per landmark",
    ),
    "doubled observations": (each("BR", lambda words: [*words, "\n", *words]), "count twice"),
    "doubled edges": (each("EDGE_SE2", lambda words: [*words, "\n", *words]), "a second edge between the poses"),
    "an edge missing": (lambda graph: graph.replace("EDGE_SE2 7 8 ", "# "), "no edge joins the poses"),
    "nan": (each("FIX", lambda words: [*words, "\nBR 3 4 nan 1 1 1"]), "is not a finite number"),
    "no line end at the end": (str.rstrip, "no line end after"),
    "in space": (
        lambda graph: graph + "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n",
        "is a graph in space, which",
    ),
    "decimal commas": (lambda graph: graph.replace(".", ","), "is not a finite number"),
}


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Imported]:
    folder = tmp_path_factory.mktemp("good")
    write_g2o(folder / "graph.g2o", read_csv_log(written(folder, GOOD)).recording)
    return (folder / "graph.g2o").read_text(), read_g2o(folder / "graph.g2o")


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_read_or_refused_or_warned_of(name: str, good: tuple[str, Imported], tmp_path: Path):
    (change, outcome), (graph, expected) = VARIANTS[name], good
    path = tmp_path / "graph.g2o"
    path.write_bytes(change(graph).encode())
    try:
        with redirect_stderr(io.StringIO()) as printed:
            log = read_g2o(path)
        said = "\n".join([*printed.getvalue().splitlines(), *log.notes, *examine(log, path).warnings])
    except UserError as error:
        log, said = None, str(error)
        assert len(said.splitlines()) == 1
    assert outcome in said if outcome != READ else said == ""
    if outcome == READ:
        assert log is not None
        recordings = [each.recording for each in (log, expected)]
        order = [np.lexsort(np.array([each.landmark, each.observation_step])) for each in recordings]
        assert_allclose(log.recording.odometry, expected.recording.odometry)
        assert_allclose(log.recording.observation[order[0]], expected.recording.observation[order[1]])
        assert_array_equal(log.recording.observation_step, expected.recording.observation_step)
