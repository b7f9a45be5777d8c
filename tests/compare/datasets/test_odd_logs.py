"""More variants of the good log of `test_import_variants`, as spreadsheets, other programs and other frames write it.

Each row has a name, changes of the files, and what must happen: "read" (the same recording, without a warning) or words
of the refusal or warning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.imported_log import Imported
from tests.compare.datasets.test_import_variants import (
    ALL,
    DEGREE,
    GOOD,
    LANDMARKS,
    ODOMETRY,
    READ,
    SEEN,
    TRUTH,
    Change,
    Files,
    both,
    cells,
    every,
    header,
    moved,
    read_if,
    rows,
    scaled,
    text,
    written,
)

MAP = "landmarks.csv"
Given = Mapping[str, str | bytes]


def table(file: str, change: Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]) -> Change:
    """Replace the columns of a file by those that `change` returns."""

    def changed(content: str) -> str:
        names, *lines = (line.split(",") for line in content.splitlines())
        columns = dict(zip(names, np.array(lines, dtype=np.float64).T, strict=True))
        columns = change(columns)
        values = np.column_stack([*columns.values()]).tolist()
        return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in values)]) + "\n"

    return text(file, changed)


def encoded(coding: str, *files: str) -> Callable[[Files], Given]:
    return lambda given: {name: content.encode(coding if name in files else "utf-8") for name, content in given.items()}


def with_map(change: Callable[[np.ndarray], np.ndarray] = np.asarray) -> Change:
    """Add the true landmarks, changed."""
    lines = [f"{name},{x!r},{y!r}" for name, (x, y) in enumerate(change(LANDMARKS).tolist())]
    return lambda files: files | {MAP: "\n".join(["landmark,x,y", *lines]) + "\n"}


def as_positions(x: str, y: str, sign: float = 1.0) -> Change:
    """Write observations as positions under two names."""

    def change(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        ranges, bearings = columns["range"], columns["bearing"]
        seen = {x: ranges * np.cos(bearings), y: sign * ranges * np.sin(bearings)}
        return {"stamp": columns["stamp"], "landmark": columns["landmark"], **seen}

    noise = header("recording.toml", "range = 0.05\nbearing = 0.02", "position = 0.08")
    return both(noise, table(SEEN, change))


def as_poses(change: Callable[[np.ndarray], np.ndarray] = np.asarray) -> Change:
    """Write the true path as odometry, changed; the odometry is then nearly without errors."""

    def changed(files: Files) -> Files:
        names, *lines = (line.split(",") for line in files[TRUTH].splitlines())
        del names
        found = np.array(lines, dtype=np.float64)
        found[:, 1:] = change(found[:, 1:])
        content = "\n".join(["stamp,x,y,theta", *(",".join(map(repr, row)) for row in found.tolist())]) + "\n"
        return {name: each for name, each in files.items() if name != TRUTH} | {ODOMETRY: content}

    return changed


def column(file: str, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    return table(file, lambda columns: columns | {name: change(columns[name])})


def some(value: float, every_nth: int = 10) -> Callable[[np.ndarray], np.ndarray]:
    """Replace every n-th value."""
    return lambda values: np.where(np.arange(len(values)) % every_nth == 3, value, values)


def words(file: str, at: int, change: Callable[[str], str]) -> Change:
    """Change a cell of each row below the header."""
    return rows(
        file,
        lambda lines: [",".join(change(w) if n == at else w for n, w in enumerate(line.split(","))) for line in lines],
    )


def with_thousands(word: str) -> str:
    return f"{float(word):,.6f}"


def in_quotes(content: str) -> str:
    return "\n".join(",".join(f'"{word}"' for word in line.split(",")) for line in content.splitlines()) + "\n"


def epoch(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return stamps of today in ns, which a float64 rounds to 256 ns."""
    return columns | {"stamp": np.round((columns["stamp"] + 1.7e9) * 1e9)}


def without(columns: dict[str, np.ndarray], begin: float, end: float) -> dict[str, np.ndarray]:
    keeps = (columns["stamp"] < begin) | (columns["stamp"] >= end)
    return {name: values[keeps] for name, values in columns.items()}


def numbered(lines: list[str]) -> list[str]:
    """Give each observation its own landmark."""
    return [",".join([line.split(",")[0], str(n), *line.split(",")[2:]]) for n, line in enumerate(lines)]


NOT_AGREE = "agree with one place per landmark"
MAP_DIFFERS = "with the true path and map are"
STATED = text("recording.toml", lambda content: content + "[start]\npose = [0.0, 0.0, 0.0]\n")
VARIANTS: dict[str, tuple[Callable[[Files], Given], str]] = {
    # texts
    "UTF-16": (encoded("utf-16", *ALL), "odometry.csv, line 1: not a text in UTF-8"),
    "Latin-1": (
        lambda files: encoded("latin-1", SEEN)(files | {SEEN: f"# Größe\n{files[SEEN]}"}),
        "line 1: not a text in UTF-8",
    ),
    "CR only": (every(*ALL, change=lambda t: t.replace("\n", "\r")), READ),
    "two kinds of line ends": (every(*ALL, change=lambda t: t.replace("\n", "\r\n", 50)), READ),
    "NUL at the end": (text(SEEN, lambda t: f"{t}\0"), "line 385: not a text in UTF-8"),
    "end of file of DOS": (text(SEEN, lambda t: f"{t}\x1a"), "line 385: has 1 columns"),
    "spaces that do not break": (text(SEEN, lambda t: t.replace(",", ",\u00a0")), READ),
    "typographic minus": (text(SEEN, lambda t: t.replace("-", "\u2212")), "is not a finite number"),
    # cells
    "all cells in quotes": (every(*ALL, change=in_quotes), READ),
    "half a quote": (rows(SEEN, lambda lines: [f'"{lines[0]}', *lines[1:]]), "line 2: has 1 columns"),
    "commas, semicolons in the header": (
        text(SEEN, lambda t: t.replace("stamp,landmark,range,bearing", "stamp;landmark;range;bearing")),
        "line 2: has 1 columns",
    ),
    "semicolons in some rows": (
        rows(SEEN, lambda lines: [*lines[:4], lines[4].replace(",", ";"), *lines[5:]]),
        "line 6: has 1 columns",
    ),
    "a separator behind each line": (text(SEEN, lambda t: t.replace("\n", ",\n")), READ),
    "thousands in quotes": (words(SEEN, 0, lambda word: f'"{with_thousands(word)}"'), "is not a finite number"),
    "thousands with apostrophes": (
        words(SEEN, 0, lambda word: with_thousands(word).replace(",", "'")),
        "is not a finite number",
    ),
    "underscores in numbers": (
        words(SEEN, 0, lambda word: with_thousands(word).replace(",", "_")),
        "is not a finite number",
    ),
    "units behind numbers": (words(SEEN, 2, lambda word: f"{word} m"), "is not a finite number"),
    "a formula": (words(SEEN, 2, lambda word: f"={word}"), "is not a finite number"),
    "plus signs": (words(SEEN, 2, lambda word: f"+{word}"), READ),
    "infinite ranges": (column(SEEN, "range", some(np.inf)), "'inf' is not a finite number"),
    "some negative ranges": (column(SEEN, "range", some(-1.0)), "line 5: the range is negative"),
    "zeros for nothing": (column(SEEN, "range", some(0.0)), "observations have range 0 m"),
    "the largest range for nothing": (column(SEEN, "range", some(81.91)), NOT_AGREE),
    "a second header": (
        rows(SEEN, lambda lines: [*lines[:50], "stamp,landmark,range,bearing", *lines[50:]]),
        "line 52: 'stamp' is not a finite number",
    ),
    "a column of row numbers": (cells(SEEN, lambda line: ["", *line]), READ),
    # names and units
    "units without a space": (both(header(SEEN, "range", "range[m]"), header(SEEN, "stamp", "stamp[s]")), READ),
    "units behind _": (
        both(scaled(SEEN, range=1e3, bearing=DEGREE), header(SEEN, "range,bearing", "range_mm,bearing_deg")),
        READ,
    ),
    "another name for the range": (header(SEEN, "range", "r_m"), "columns that are not used: r_m"),
    "two units": (header(SEEN, "bearing", "bearing [deg] [rad]"), "range-only landmarks are not supported"),
    "v and omega exchanged": (header(ODOMETRY, "v,omega", "omega,v"), "times the turns of the odometry"),
    # ids
    "ids that are texts": (words(SEEN, 1, lambda word: f"tree{word}"), "'tree0' is not an id; give a whole number"),
    "ids with _": (words(SEEN, 1, lambda word: f"1_{word}"), "'1_0' is not an id"),
    "ids with leading zeros": (words(SEEN, 1, lambda word: f"00{word}"), READ),
    "ids with exponents": (words(SEEN, 1, lambda word: f"{float(word):.6e}"), READ),
    "huge ids": (words(SEEN, 1, lambda word: f"1{word}{'0' * 19}"), "is not an id"),
    "a new id each time": (rows(SEEN, numbered), "no landmark is observed at two steps"),
    "one id for all": (column(SEEN, "landmark", np.zeros_like), NOT_AGREE),
    "two ids exchanged at half time": (
        table(
            SEEN,
            lambda each: (
                each
                | {
                    "landmark": np.where(
                        (each["stamp"] > 1015) & (each["landmark"] < 2), 1 - each["landmark"], each["landmark"]
                    )
                }
            ),
        ),
        NOT_AGREE,
    ),
    # stamps
    "stamps of today in ns": (
        both(*(both(table(file, epoch), header(file, "stamp", "stamp [ns]")) for file in ALL)),
        READ,
    ),
    "stamps of today in ns, without the unit": (both(*(table(file, epoch) for file in ALL)), "check the units"),
    "stamps in whole seconds": (column(SEEN, "stamp", np.round), NOT_AGREE),
    "dates": (words(SEEN, 0, lambda word: f"2024-01-01T00:{word}"), "is not a time"),
    "one line in the wrong place": (
        rows(SEEN, lambda lines: [*lines[:50], lines[60], *lines[50:60], *lines[61:]]),
        "line 53: stamp 1003.000000000 comes after 1003.300000000",
    ),
    "five seconds without odometry": (
        table(ODOMETRY, lambda columns: without(columns, 1010.0, 1015.0)),
        "no row for 5.1 s from 1009.9 s on",
    ),
    "no observations": (rows(SEEN, lambda _: []), "there are no observations"),
    # frames
    "bearings of 0 to 2 pi": (column(SEEN, "bearing", lambda values: values % (2 * np.pi)), READ),
    "bearings from the left": (column(SEEN, "bearing", lambda values: values - np.pi / 2), NOT_AGREE),
    "bearings of a compass": (column(SEEN, "bearing", lambda values: np.pi / 2 - values), NOT_AGREE),
    "positions, x and y exchanged": (as_positions("y", "x"), NOT_AGREE),
    "positions, y to the right": (as_positions("x", "y", -1.0), "angles in opposite directions"),
    "ranges in feet": (scaled(SEEN, range=1 / 0.3048), NOT_AGREE),
    "speeds in km/h": (scaled(ODOMETRY, v=3.6), NOT_AGREE),
    "backwards": (scaled(ODOMETRY, v=-1), NOT_AGREE),
    "wheels that do not count": (scaled(ODOMETRY, v=0), NOT_AGREE),
    "poses, headings in degrees": (as_poses(lambda poses: poses * [1, 1, DEGREE]), NOT_AGREE),
    "poses, y downwards": (as_poses(lambda poses: poses * [1, -1, 1]), NOT_AGREE),
    "poses, x and y exchanged": (as_poses(lambda poses: poses[:, [1, 0, 2]]), NOT_AGREE),
    "poses at a lower rate, repeated": (as_poses(lambda poses: np.repeat(poses[::5], 5, axis=0)[:301]), NOT_AGREE),
    # truth
    "a true map": (with_map(), READ),
    "true x and y exchanged": (with_map(lambda places: places[:, ::-1]), MAP_DIFFERS),
    "true map in mm": (with_map(lambda places: 1e3 * places), MAP_DIFFERS),
    "true map with other ids": (with_map(lambda places: np.roll(places, 1, axis=0)), MAP_DIFFERS),
    "true map mirrored": (with_map(lambda places: places * [1, -1]), MAP_DIFFERS),
    "true map in another frame": (with_map(lambda places: places + np.array([10, 5])), MAP_DIFFERS),
    "true map, an id twice": (
        both(with_map(), rows(MAP, lambda lines: [*lines, lines[0]])),
        "must be >= 0 and distinct",
    ),
    "truth a second early": (both(moved(TRUTH, "stamp", -1.0), STATED), "turns 1 s before the odometry"),
    "truth with headings of a compass": (column(TRUTH, "theta", lambda values: np.pi / 2 - values), "true path has"),
    "truth at one step": (rows(TRUTH, lambda lines: lines[:1]), "the true path has poses at 1 of 301 steps"),
    "truth that does not move": (
        rows(TRUTH, lambda lines: [f"{999 + n},0,0,0" for n in range(len(lines))]),
        "has 0 times",
    ),
}


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Imported:
    return read_csv_log(written(tmp_path_factory.mktemp("good"), GOOD))


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_is_read_or_refused_or_warned_of(name: str, expected: Imported, tmp_path: Path):
    change, outcome = VARIANTS[name]
    written(tmp_path, change(GOOD))
    log = read_if(outcome, tmp_path)
    if log is None:
        return
    since = [each.recording.stamps - each.recording.stamps[0] for each in (log, expected)]
    assert_allclose(*since, atol=1e-6)
    for field in ("odometry", "observation", "odometry_cov", "observation_cov"):
        assert_allclose(getattr(log.recording, field), getattr(expected.recording, field), rtol=1e-5, atol=1e-6)
    assert_array_equal(log.recording.landmark, expected.recording.landmark)
