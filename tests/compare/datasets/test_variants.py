"""Variants of one good log and one good graph: each is read as they are, or refused or warned of in a line.

Each row of a table has a name, changes of the files, and what must happen: "read" (the same recording, without a
warning) or words of the refusal or warning.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from contextlib import redirect_stderr
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge import load_scenario, simulate
from slamgauge.arrays import Float
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.g2o_writer import write_g2o
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.plausibility import examine
from slamgauge.errors import UserError
from tests.reference.given import given
from tests.reference.log_changes import (
    ALL,
    LANDMARKS,
    MAP,
    MAPPING,
    ODOMETRY,
    SEEN,
    TRUTH,
    Change,
    Files,
    both,
    cells,
    column,
    every,
    good_log,
    header,
    moved,
    rows,
    scaled,
    settings,
    some,
    table,
    text,
    words,
)

GOOD = good_log()
DEGREE = 180.0 / np.pi
READ = "read"
NUMBER, NOT_AGREE = "is not a finite number", "agree with one place per landmark"
NOISE_DIFFERS = "the measurements do not fit their stated noise"
MAP_DIFFERS = "with the true path and map are"
DEG = settings("[observations]\nangle = 'deg'\n")
ODOMETRY_NOISE = "forward = 0.05\nlateral = 0.01\nturn = 0.02"
SENSOR_NOISE = "range = 0.05\nbearing = 0.02"
EPOCHS = {"times of ISO 8601": 1_714_563_800.0, "stamps of today in ns": 1.7e9}  # s before the log's second 0
Read = Callable[[Path], Imported]


def with_map(change: Callable[[Float], Float] = np.asarray) -> Change:
    """Add the true landmarks, changed."""
    lines = [f"{name},{x!r},{y!r}" for name, (x, y) in enumerate(change(LANDMARKS).tolist())]
    return lambda files: files | {MAP: "\n".join(["landmark,x,y", *lines]) + "\n"}


def as_positions(x: str, y: str, sign: float = 1.0) -> Change:
    """Write observations as positions under two names."""

    def change(columns: dict[str, Float]) -> dict[str, Float]:
        ranges, bearings = columns["range"], columns["bearing"]
        seen = {x: ranges * np.cos(bearings), y: sign * ranges * np.sin(bearings)}
        return {"stamp": columns["stamp"], "landmark": columns["landmark"], **seen}

    return both(header(MAPPING, SENSOR_NOISE, "position = 0.08"), table(SEEN, change))


def with_quaternions(columns: dict[str, Float]) -> dict[str, Float]:
    half, zero = columns.pop("theta") / 2, np.zeros_like(columns["x"])
    return columns | {"qx": zero, "qy": zero, "qz": 3 * np.sin(half), "qw": 3 * np.cos(half)}


def in_two_columns(columns: dict[str, Float]) -> dict[str, Float]:
    stamps = columns.pop("stamp")
    return {"sec": np.floor(stamps), "nanosec": np.round((stamps % 1.0) * 1e9)} | columns


def as_time(word: str) -> str:
    """Write a stamp as a time, at which the log's second 1000 is noon."""
    return f"2024-05-01T12:00:{float(word) - 1000.0:09.6f}"


def in_quotes(content: str) -> str:
    return "\n".join(",".join(f'"{word}"' for word in line.split(",")) for line in content.splitlines()) + "\n"


def epoch(columns: dict[str, Float]) -> dict[str, Float]:
    """Return stamps of today in ns, which a float64 rounds to 256 ns."""
    return columns | {"stamp": np.round((columns["stamp"] + 1.7e9) * 1e9)}


def numbered(lines: list[str]) -> list[str]:
    """Give each observation its own landmark."""
    return [",".join([line.split(",")[0], str(n), *line.split(",")[2:]]) for n, line in enumerate(lines)]


def twice(lines: list[str]) -> list[str]:
    return [each for line in lines for each in (line, line)]


LOGS: dict[str, tuple[Change, str]] = {
    # texts and cells
    "as it is": (both(), READ),
    "semicolons": (every(*ALL, change=lambda t: t.replace(",", ";")), READ),
    "tabs": (every(*ALL, change=lambda t: t.replace(",", "\t")), READ),
    "spaces": (text(SEEN, lambda t: t.replace(",", " ")), "does not have the columns"),
    "space after the comma": (every(*ALL, change=lambda t: t.replace(",", ", ")), READ),
    "decimal commas": (text(SEEN, lambda t: t.replace(",", ";").replace(".", ",")), NUMBER),
    "blank lines at the end": (every(*ALL, change=lambda t: t + "\n \n\n"), READ),
    "no line end at the end": (text(TRUTH, str.rstrip), "no line end after"),
    "a line cut short": (text(SEEN, lambda t: t[:-12]), "words, not"),
    "header behind #": (text(ODOMETRY, lambda t: "# " + t), READ),
    "all cells in quotes": (every(*ALL, change=in_quotes), READ),
    "another column": (cells(SEEN, lambda line: [*line, "note"]), "columns that are not used: note"),
    "other order": (cells(SEEN, lambda line: line[::-1]), READ),
    "no header": (text(SEEN, lambda t: t.split("\n", 1)[1]), "line 1: does not have the columns"),
    "a separator behind each line": (text(SEEN, lambda t: t.replace("\n", ",\n")), READ),
    "underscores in numbers": (words(SEEN, 0, lambda word: f"{float(word):_.6f}"), NUMBER),
    "some negative ranges": (column(SEEN, "range", some(-1.0)), "line 5: the range is negative"),
    # names and units
    "other words": (
        both(header(ODOMETRY, "stamp,v,omega", "time,speed,yaw_rate"), header(SEEN, "landmark", "id")),
        READ,
    ),
    "units in the header": (header(ODOMETRY, "stamp,v,omega", "Time [s],Speed (m/s),yaw rate [rad/s]"), READ),
    "units behind _": (
        both(scaled(SEEN, range=1e3, bearing=DEGREE), header(SEEN, "range,bearing", "range_mm,bearing_deg")),
        READ,
    ),
    "degrees by the settings": (both(scaled(SEEN, bearing=DEGREE), DEG), READ),
    "mm by the settings": (both(scaled(SEEN, range=1e3), settings("[observations]\nlength = 'mm'\n")), READ),
    "two units": (
        both(header(SEEN, "bearing", "bearing [rad]"), DEG),
        "in rad by the header, and in deg by the setting",
    ),
    "feet": (header(SEEN, "range", "range [ft]"), "'ft' is not a unit of range"),
    "two columns of one name": (cells(SEEN, lambda line: [*line, line[3]]), "two columns are called 'bearing'"),
    "one column for two": (
        settings("[observations]\ncolumns = {range = 'bearing'}\n"),
        "is used for range and bearing",
    ),
    "an unknown column in the settings": (settings("[odometry]\ncolumns = {w = 'omega'}\n"), "columns.w: unknown"),
    # stamps and ids
    "seconds and nanoseconds": (both(*(table(file, in_two_columns) for file in ALL)), READ),
    "times of ISO 8601": (both(*(words(file, 0, as_time) for file in ALL)), READ),
    "times, and seconds from the start": (
        both(words(ODOMETRY, 0, as_time), moved(SEEN, "stamp", -1000.0), moved(TRUTH, "stamp", -1000.0)),
        "observations.csv: stamps are seconds, those of the odometry times: they count from its first row",
    ),
    "quaternions": (table(TRUTH, with_quaternions), READ),
    "a new id each time": (rows(SEEN, numbered), "no landmark is observed at two steps"),
    "one id for all": (column(SEEN, "landmark", np.zeros_like), NOT_AGREE),
    "stamps of today in ns": (
        both(*(both(table(file, epoch), header(file, "stamp", "stamp [ns]")) for file in ALL)),
        READ,
    ),
    "stamps of today in ns, without the unit": (both(*(table(file, epoch) for file in ALL)), "check the units"),
    "doubled observations": (rows(SEEN, twice), "repeat step, landmark and values of another one"),
    "doubled odometry": (rows(ODOMETRY, twice), "is not after that of the line above"),
    "one line in the wrong place": (
        rows(SEEN, lambda lines: [*lines[:50], lines[60], *lines[50:60], *lines[61:]]),
        "line 53: stamp 1003.000000000 is before that of the line above",
    ),
    "observations in ms": (scaled(SEEN, stamp=1e3), "give each file the unit of its stamps"),
    "all stamps in ms": (both(*(scaled(file, stamp=1e3) for file in ALL)), "check the units of angles and stamps"),
    "observations 1 s early": (moved(SEEN, "stamp", -1.0), "if their stamps are 1 s early"),
    "no observations": (rows(SEEN, lambda _: []), "there are no observations"),
    # units, signs and frames
    "bearings in degrees": (scaled(SEEN, bearing=DEGREE), "more than a full turn"),
    "bearings in radians, read as degrees": (DEG, "in radians, read as degrees"),
    "clockwise bearings": (scaled(SEEN, bearing=-1), "angles in opposite directions"),
    "both clockwise": (both(scaled(SEEN, bearing=-1), scaled(ODOMETRY, omega=-1)), "-0.997 times the turns"),
    "turns in degrees": (scaled(ODOMETRY, omega=DEGREE), "yaw rates are in deg/s, read as rad/s"),
    "turns in radians, read as degrees": (settings("[odometry]\nangle = 'deg'\n"), "turns are in radians, read as deg"),
    "ranges in mm": (scaled(SEEN, range=1e3), "observed lengths are 1000 times too large"),
    "range and bearing exchanged": (header(SEEN, "range,bearing", "bearing,range"), "the range is negative"),
    "ranges in m, read as mm": (settings("[observations]\nlength = 'mm'\n"), "lengths are 1000 times too small"),
    "speeds in mm": (scaled(ODOMETRY, v=1e3), "1000 times too large"),
    "bearings of 0 to 2 pi": (column(SEEN, "bearing", lambda values: values % (2 * np.pi)), READ),
    "backwards": (scaled(ODOMETRY, v=-1), NOT_AGREE),
    "positions, y to the right": (as_positions("x", "y", -1.0), "angles in opposite directions"),
    # noise
    "sensor noise too small": (header(MAPPING, SENSOR_NOISE, "range = 5e-4\nbearing = 2e-4"), "`slamgauge noise`"),
    # truth
    "truth in mm": (scaled(TRUTH, x=1e3, y=1e3), "the true path has 996 times the distances"),
    "truth half a second early": (
        moved(TRUTH, "stamp", -0.5),
        "the true path turns 0.5 s before the odometry; add 0.5 s to its stamps",
    ),
    "lengths in m, read as mm, but those of the truth": (
        settings("[observations]\nlength = 'mm'\n[odometry]\nlength = 'mm'\n"),
        "the true path has 996 times the distances of the odometry",
    ),
    "truth of another clock": (moved(TRUTH, "stamp", 1e6), ": start.pose: the ground truth has no pose at the start"),
    "truth at one step": (rows(TRUTH, lambda lines: lines[:1]), "the true path has poses at 1 of 301 steps"),
    "a true map": (with_map(), READ),
    "true map with other ids": (with_map(lambda places: np.roll(places, 1, axis=0)), MAP_DIFFERS),
    "true map, an id twice": (
        both(with_map(), rows(MAP, lambda lines: [*lines, lines[0]])),
        "must be >= 0 and distinct",
    ),
}


def written(folder: Path, files: Files) -> Path:
    for name, content in files.items():
        (folder / name).write_bytes(content.encode())
    return folder


def read_as(outcome: str, read: Read, path: Path) -> Imported | None:
    """Assert an outcome of the tables; return the log if it must be read without a word, except facts."""
    log = None
    try:
        with redirect_stderr(io.StringIO()) as printed:
            log = read(path)
        said = "\n".join([*printed.getvalue().splitlines(), *log.notes, *examine(log, path)[1]])
    except UserError as error:
        said = str(error)
        assert len(said.splitlines()) == 1
    if outcome != READ:
        assert outcome in said
        return None
    assert not said or re.fullmatch(r"\d+ keys of GTSAM .*: l7 is 7108", said)
    return given(log)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Imported:
    return read_csv_log(written(tmp_path_factory.mktemp("good"), GOOD))


@pytest.mark.parametrize("name", LOGS)
def test_a_variant_of_the_log(name: str, good: Imported, tmp_path: Path):
    change, outcome = LOGS[name]
    log = read_as(outcome, read_csv_log, written(tmp_path, change(GOOD)))
    if log is None:
        return
    since = good.recording.stamps + EPOCHS.get(name, 0.0)
    assert_allclose(log.recording.stamps, since, rtol=0, atol=2e-6)
    for field in ("odometry", "observation", "odometry_cov", "observation_cov"):
        assert_allclose(getattr(log.recording, field), getattr(good.recording, field), rtol=1e-5, atol=1e-6)
    assert_array_equal(log.recording.landmark, good.recording.landmark)
    if "truth.csv" in change(GOOD):
        assert_allclose(given(given(log.truth).poses), given(given(good.truth).poses), atol=1e-4)


def test_a_unit_that_makes_lengths_smaller_than_their_noise_is_not_suggested(tmp_path: Path) -> None:
    """Ranges in feet over 3 s agree with one place per landmark once all lengths are divided by 100 or 1000."""
    _, recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=3"]), 3)
    log = Imported(replace(recording, observation=recording.observation * [3.28, 1.0]))
    assert "check units" in " ".join(examine(log, tmp_path)[1])


# --- graphs --------------------------------------------------------------------------------------

Words = Callable[[list[str]], list[str]]
ChangedGraph = Callable[[str], str]


def each(tag: str, change: Words) -> ChangedGraph:
    """Change the words of the lines of a tag."""

    def changed(line: str) -> str:
        parts = line.split()
        return " ".join(change(parts)) if parts and parts[0] == tag else line

    return lambda graph: "".join(f"{changed(line)}\n" for line in graph.splitlines())


def times(tag: str, at: int, factor: float) -> ChangedGraph:
    return each(tag, lambda line: [*line[:at], repr(float(line[at]) * factor), *line[at + 1 :]])


def with_keys(graph: str) -> str:
    """Write the ids of poses and landmarks as keys of GTSAM."""
    pose, landmark = (ord(letter) << 56 for letter in "xl")
    firsts = {"VERTEX_XY": (landmark,), "EDGE_SE2": (pose, pose), "BR": (pose, landmark)}
    lines = list[str]()
    for line in graph.splitlines():
        tag, *parts = line.split()
        keys = [str(first + int(word)) for first, word in zip(firsts.get(tag, (pose,)), parts, strict=False)]
        lines.append(" ".join([tag, *keys, *parts[len(keys) :]]))
    return "\n".join([*lines, ""])


GRAPHS: dict[str, tuple[ChangedGraph, str]] = {
    "remarks and blank lines": (lambda graph: "# a graph\n\n" + graph.replace("FIX", "\nFIX") + "\n\n", READ),
    "lines from the last to the first": (lambda graph: "\n".join([*graph.splitlines()[::-1], ""]), READ),
    "landmarks without vertices": (each("VERTEX_XY", lambda _: []), READ),
    "keys of GTSAM": (with_keys, READ),
    "clockwise bearings": (times("BR", 3, -1.0), "angles in opposite directions"),
    "turns in degrees": (times("EDGE_SE2", 5, DEGREE), "turns are in degrees, read as radians"),
    "variances instead of information": (times("EDGE_SE2", 6, 1e-10), NOISE_DIFFERS),
    "doubled edges": (each("EDGE_SE2", lambda line: [*line, "\n", *line]), "a second edge between the poses"),
    "in space": (lambda graph: graph + "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n", "is a graph in space, which"),
    "ranges only": (lambda graph: graph + "EDGE_RANGE_SE2_XY 3 4 1 1\n", "is a range-only edge, which"),
    "prior of a landmark": (lambda graph: graph + "EDGE_PRIOR_POINTXY 4 1 1\n", "is a prior of a landmark or a pos"),
    "fixed landmark": (lambda graph: graph + "FIX 5\n", "landmark 5 is fixed, which is not supported"),
}


@pytest.fixture(scope="module")
def good_graph(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Imported]:
    folder = tmp_path_factory.mktemp("good")
    write_g2o(folder / "graph.g2o", read_csv_log(written(folder, GOOD)).recording)
    return (folder / "graph.g2o").read_text(), read_g2o(folder / "graph.g2o")


@pytest.mark.parametrize("name", GRAPHS)
def test_a_variant_of_the_graph(name: str, good_graph: tuple[str, Imported], tmp_path: Path):
    (change, outcome), (graph, expected) = GRAPHS[name], good_graph
    (tmp_path / "graph.g2o").write_bytes(change(graph).encode())
    log = read_as(outcome, read_g2o, tmp_path / "graph.g2o")
    if log is None:
        return
    recordings = [each.recording for each in (log, expected)]
    order = [np.lexsort(np.array([each.landmark, each.observation_step])) for each in recordings]
    assert_allclose(log.recording.odometry, expected.recording.odometry)
    assert_allclose(log.recording.observation[order[0]], expected.recording.observation[order[1]])
    assert_array_equal(log.recording.observation_step, expected.recording.observation_step)
    if name == "keys of GTSAM":
        expected_ids = 1000 * given(expected.recording.landmark) + ord("l")
        assert_array_equal(np.sort(given(log.recording.landmark)), np.sort(expected_ids))
