"""Variants of one good log: each is read as the log, or refused or warned of in a line.

Each row of a table has a name, changes of the files, and what must happen: "read" (the same recording, without a
warning) or words of the refusal or warning.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from slamgauge import load_scenario, simulate
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.imported_log import Imported
from slamgauge.compare.datasets.plausibility import examine
from slamgauge.errors import UserError
from slamgauge.se2 import compose, exp

Files = dict[str, str]
Change = Callable[[Files], Files]
SETTINGS = "[noise]\nper = 'speed'\nforward = 0.05\nlateral = 0.01\nturn = 0.02\nrange = 0.05\nbearing = 0.02\n"
LANDMARKS = np.array([[2.0, 3.0], [-2.0, 4.0], [4.0, -1.0], [-3.0, -2.0], [0.5, 6.0], [6.0, 4.0]])
DEGREE = 180.0 / np.pi
READ = "read"


def good_log() -> Files:
    """Return 300 steps of 0.1 s of a robot that drives arcs of both directions, with 0.5 m/s and up to 0.35 rad/s."""
    rng = np.random.default_rng(8)
    stamps = 1000.0 + 0.1 * np.arange(301)
    speeds = np.column_stack([np.full(301, 0.5), np.zeros(301), np.where(np.arange(301) % 120 < 80, 0.35, -0.2)])
    driven = speeds + rng.normal(size=(301, 3)) * [0.05, 0.01, 0.02]
    poses = [np.zeros(3)]
    for each in driven[:-1]:
        poses.append(compose(poses[-1], exp(0.1 * each)))
    odometry = ["stamp,v,omega", *(f"{t:.3f},{v:.6f},{w:.6f}" for t, (v, _, w) in zip(stamps, speeds, strict=True))]
    seen = ["stamp,landmark,range,bearing"]
    for stamp, pose in zip(stamps[::3], poses[::3], strict=True):
        for name, (x, y) in enumerate(LANDMARKS - pose[:2]):
            distance, bearing = np.hypot(x, y) + rng.normal(0, 0.05), np.arctan2(y, x) - pose[2] + rng.normal(0, 0.02)
            if distance < 6.0:
                seen.append(f"{stamp:.3f},{name},{distance:.6f},{np.angle(np.exp(1j * bearing)):.6f}")
    path = [f"{t:.3f},{x:.6f},{y:.6f},{h:.6f}" for t, (x, y, h) in zip(stamps, poses, strict=True)]
    texts = {"odometry.csv": odometry, "observations.csv": seen, "truth.csv": ["stamp,x,y,theta", *path]}
    return {name: "\n".join(lines) + "\n" for name, lines in texts.items()} | {"recording.toml": SETTINGS}


GOOD = good_log()
ODOMETRY, SEEN, TRUTH = "odometry.csv", "observations.csv", "truth.csv"


def text(file: str, change: Callable[[str], str]) -> Change:
    return lambda files: files | {file: change(files[file])}


def every(*files: str, change: Callable[[str], str]) -> Change:
    return lambda given: given | {file: change(given[file]) for file in files}


def scaled(file: str, **factors: float) -> Change:
    """Multiply columns of a file."""

    def change(content: str) -> str:
        header, *rows = content.splitlines()
        names = header.split(",")
        table = np.array([[float(word) for word in row.split(",")] for row in rows])
        for name, factor in factors.items():
            table[:, names.index(name)] *= factor
        return "\n".join([header, *(",".join(map(repr, row)) for row in table.tolist())]) + "\n"

    return text(file, change)


def moved(file: str, column: str, by: float) -> Change:
    def change(content: str) -> str:
        header, *rows = content.splitlines()
        at = header.split(",").index(column)
        table = [row.split(",") for row in rows]
        for words in table:
            words[at] = repr(float(words[at]) + by)
        return "\n".join([header, *map(",".join, table)]) + "\n"

    return text(file, change)


def header(file: str, old: str, new: str) -> Change:
    return text(file, lambda content: content.replace(old, new, 1))


def settings(lines: str) -> Change:
    return lambda files: files | {"recording.toml": files["recording.toml"] + lines}


def both(*changes: Change) -> Change:
    def change(files: Files) -> Files:
        for each in changes:
            files = each(files)
        return files

    return change


def rows(file: str, change: Callable[[list[str]], list[str]]) -> Change:
    def changed(content: str) -> str:
        head, *lines = content.splitlines()
        return "\n".join([head, *change(lines)]) + "\n"

    return text(file, changed)


def sep(separator: str, decimal: str = ".") -> Callable[[str], str]:
    """Write another separator and another decimal sign."""
    return lambda content: content.replace(",", separator).replace(".", decimal)


def quoted(content: str) -> str:
    """Write decimal commas, each number in quotes."""
    head, *lines = content.splitlines()
    return "\n".join([head, *(",".join(f'"{word.replace(".", ",")}"' for word in row.split(",")) for row in lines), ""])


def cells(file: str, change: Callable[[list[str]], list[str]]) -> Change:
    """Change the cells of each line."""
    return text(
        file, lambda content: "".join(f"{','.join(change(line.split(',')))}\n" for line in content.splitlines())
    )


KIND = settings("[observations]\nkind = 'range-bearing'\n")
DEG, MM = (settings(f"[observations]\n{unit}\n") for unit in ("angle = 'deg'", "length = 'mm'"))
ODOMETRY_DEG, ODOMETRY_MM = (settings(f"[odometry]\n{unit}\n") for unit in ("angle = 'deg'", "length = 'mm'"))
ALL = (ODOMETRY, SEEN, TRUTH)
ODOMETRY_NOISE = "forward = 0.05\nlateral = 0.01\nturn = 0.02"
SENSOR_NOISE = "range = 0.05\nbearing = 0.02"


def column_of_logarithms(files: Files) -> Files:
    """Write logarithms of the ranges, all of which are above 1 m."""
    words = [line.split(",") for line in files[SEEN].splitlines()]
    rows = [[*row[:2], repr(float(np.log(max(float(row[2]), 1.01)))), row[3]] for row in words[1:]]
    return files | {SEEN: "".join(",".join(row) + "\n" for row in [words[0], *rows])}


def headless(content: str) -> str:
    return content.split("\n", 1)[1]


def stamps_in(unit: str, factor: float) -> Change:
    return both(
        *(scaled(file, stamp=factor) for file in ALL), *(header(file, "stamp", f"stamp [{unit}]") for file in ALL)
    )


def twice(lines: list[str]) -> list[str]:
    return [each for line in lines for each in (line, line)]


def last_cell(value: str) -> Change:
    """Replace the last cell of the first row."""
    return rows(SEEN, lambda lines: [lines[0].rsplit(",", 1)[0] + "," + value, *lines[1:]])


VARIANTS: dict[str, tuple[Change, str]] = {
    # other forms
    "as it is": (both(), READ),
    "semicolons": (every(*ALL, change=sep(";")), READ),
    "tabs": (every(*ALL, change=sep("\t")), READ),
    "spaces": (every(*ALL, change=sep(" ")), READ),
    "space after the comma": (every(*ALL, change=sep(", ")), READ),
    "decimal commas in quotes": (every(*ALL, change=quoted), "is not a finite number"),
    "decimal commas and commas": (text(SEEN, sep(",", ",")), "columns where the first line has"),
    "byte order mark": (every(*ALL, "recording.toml", change=lambda t: "\ufeff" + t), READ),
    "line ends of Windows": (every(*ALL, change=lambda t: t.replace("\n", "\r\n")), READ),
    "blank lines at the end": (every(*ALL, change=lambda t: t + "\n \n\n"), READ),
    "no line end at the end": (text(TRUTH, str.rstrip), "no line end after"),
    "the last number cut short": (text(SEEN, lambda t: t[:-4]), "no line end after"),
    "a remark": (text(SEEN, lambda t: "# laser\n" + t), READ),
    "header behind #": (text(ODOMETRY, lambda t: "# " + t), READ),
    "header behind %": (text(ODOMETRY, lambda t: "%" + t), READ),
    "capital letters": (header(SEEN, "stamp,landmark,range", "Stamp,LANDMARK,Range"), READ),
    "names in quotes": (header(SEEN, "stamp,landmark", '"stamp","landmark"'), READ),
    "another column": (cells(SEEN, lambda words: [*words, "note"]), "columns that are not used: note"),
    "other order": (cells(SEEN, lambda words: words[::-1]), READ),
    "exponents": (rows(SEEN, lambda lines: [f"{line}e0" for line in lines]), READ),
    "ids with a decimal point": (
        cells(SEEN, lambda words: [words[0], words[1] + ".0" * (words[1] < "A"), *words[2:]]),
        READ,
    ),
    "no header, and a kind": (both(text(SEEN, headless), KIND), READ),
    "no header": (text(SEEN, headless), "no header"),
    # names and units
    "other words": (
        both(header(ODOMETRY, "stamp,v,omega", "time,speed,yaw_rate"), header(SEEN, "landmark", "id")),
        READ,
    ),
    "units in the header": (header(ODOMETRY, "stamp,v,omega", "Time [s],Speed (m/s),yaw rate [rad/s]"), READ),
    "a row of units": (text(SEEN, lambda t: t.replace("\n", "\ns,-,m,rad\n", 1)), READ),
    "a row of units in brackets": (text(SEEN, lambda t: t.replace("\n", "\n[s],[-],[m],[rad]\n", 1)), READ),
    "a row of units, one missing": (
        text(SEEN, lambda t: t.replace("\n", "\ns,m,rad\n", 1)),
        "has 3 units for 4 columns",
    ),
    "degrees by the header": (both(scaled(SEEN, bearing=DEGREE), header(SEEN, "bearing", "bearing [deg]")), READ),
    "degrees by their sign": (both(scaled(SEEN, bearing=DEGREE), header(SEEN, "bearing", "bearing (°)")), READ),
    "degrees by a row of units": (both(scaled(SEEN, bearing=DEGREE), header(SEEN, "\n", "\ns,,m,deg\n")), READ),
    "degrees by the settings": (both(scaled(SEEN, bearing=DEGREE), DEG), READ),
    "deg/s by the header": (both(scaled(ODOMETRY, omega=DEGREE), header(ODOMETRY, "omega", "omega (deg/s)")), READ),
    "mm by the header": (both(scaled(SEEN, range=1e3), header(SEEN, "range", "range [mm]")), READ),
    "cm by the header": (both(scaled(SEEN, range=1e2), header(SEEN, "range", "range (cm)")), READ),
    "mm/s by the header": (both(scaled(ODOMETRY, v=1e3), header(ODOMETRY, "v", "v [mm/s]")), READ),
    "mm by the settings": (both(scaled(SEEN, range=1e3), MM), READ),
    "ms by the header": (stamps_in("ms", 1e3), READ),
    "us by the header": (stamps_in("us", 1e6), READ),
    "ns by the header": (stamps_in("ns", 1e9), READ),
    "feet": (header(SEEN, "range", "range [ft]"), "'ft' is not a unit of range"),
    "km/h": (header(ODOMETRY, "v", "v [km/h]"), "'km/h' is not a unit of v"),
    "speed in m": (header(ODOMETRY, "v", "v [m]"), "'m' is not a unit of v"),
    "bearing in metres": (header(SEEN, "bearing", "bearing [m]"), "'m' is not a unit of bearing"),
    "two units": (both(header(SEEN, "bearing", "bearing [rad]"), DEG), "in rad by the header, and in deg"),
    "unknown unit in the settings": (settings("[observations]\nangle = 'gon'\n"), "must be one of rad, deg"),
    "unknown name": (header(SEEN, "bearing", "azimuth"), "range-only landmarks are not supported"),
    "two columns of one name": (cells(SEEN, lambda words: [*words, words[3]]), "two columns are called 'bearing'"),
    "one column for two": (settings("[observations]\ncolumns = {range = 4}\n"), "is used for range and bearing"),
    "one name for two": (settings("[odometry]\ncolumns = {v = 'omega'}\n"), "is used for v and omega"),
    # values that contradict each other
    "bearings in degrees": (scaled(SEEN, bearing=DEGREE), "more than a full turn"),
    "bearings in radians, read as degrees": (DEG, "in radians, read as degrees"),
    "clockwise bearings": (scaled(SEEN, bearing=-1), "angles in opposite directions"),
    "clockwise odometry": (scaled(ODOMETRY, omega=-1), "angles in opposite directions"),
    "both clockwise": (
        both(scaled(SEEN, bearing=-1), scaled(ODOMETRY, omega=-1)),
        "true path has -0.997 times the turns",
    ),
    "turns in degrees": (scaled(ODOMETRY, omega=DEGREE), "check the units of angles and stamps"),
    "turns in radians, read as degrees": (ODOMETRY_DEG, "turns are in radians, read as degrees"),
    "ranges in mm": (scaled(SEEN, range=1e3), "observed lengths are 1000 times too large"),
    "ranges in cm": (scaled(SEEN, range=1e2), "observed lengths are 100 times too large"),
    "ranges in m, read as mm": (MM, "observed lengths are 1000 times too small"),
    "speeds in mm": (scaled(ODOMETRY, v=1e3), "1000 times too large"),
    "speeds in m, read as mm": (ODOMETRY_MM, "distances of the odometry are 1000 times too small"),
    "all lengths in mm": (
        both(scaled(SEEN, range=1e3), scaled(ODOMETRY, v=1e3)),
        "all lengths are 1000 times too large",
    ),
    "a start far away": (settings("[start]\npose = [1e15, 0.0, 0.0]\n"), "where centimetres are rounded"),
    "truth in mm": (scaled(TRUTH, x=1e3, y=1e3), "the true path has 996 times the distances"),
    "truth in degrees": (scaled(TRUTH, theta=DEGREE), "the true path has"),
    "truth of another clock": (moved(TRUTH, "stamp", 1e6), "no pose at the start"),
    "observations in ms": (scaled(SEEN, stamp=1e3), "give each file the unit of its stamps"),
    "observations in ns": (scaled(SEEN, stamp=1e9), "give each file the unit of its stamps"),
    "odometry in ms": (scaled(ODOMETRY, stamp=1e3), "check the units of angles and stamps"),
    "all stamps in ms": (both(*(scaled(file, stamp=1e3) for file in ALL)), "check the units of angles and stamps"),
    "observations an hour late": (moved(SEEN, "stamp", 3600.0), "both the same clock"),
    "observations 10 s late": (moved(SEEN, "stamp", 10.0), "agree with one place per landmark"),
    "observations 2 s late": (moved(SEEN, "stamp", 2.0), "if their stamps are 2 s late"),
    "observations 1 s early": (moved(SEEN, "stamp", -1.0), "if their stamps are 1 s early"),
    "doubled observations": (rows(SEEN, twice), "count twice"),
    "doubled odometry": (rows(ODOMETRY, twice), "is that of the line above"),
    "odometry in wrong order": (rows(ODOMETRY, lambda lines: lines[::-1]), "comes after"),
    "noise stated too small": (
        header("recording.toml", SENSOR_NOISE, "range = 5e-4\nbearing = 2e-4"),
        "`slamgauge noise`",
    ),
    "noise stated too large": (
        header("recording.toml", SENSOR_NOISE, "range = 5\nbearing = 2"),
        "do not fit their stated noise",
    ),
    "standard deviations as variances": (
        header("recording.toml", SENSOR_NOISE, "range = 0.2236\nbearing = 0.1414"),
        "do not fit their stated noise",
    ),
    "variances of the odometry": (
        header("recording.toml", ODOMETRY_NOISE, "forward = 0.0025\nlateral = 0.0001\nturn = 0.0004"),
        "`slamgauge noise`",
    ),
    "ids at random": (
        rows(
            SEEN,
            lambda lines: [line.replace(f",{line.split(',')[1]},", f",{n % 5},", 1) for n, line in enumerate(lines)],
        ),
        "agree with one place per landmark",
    ),
    "half an id": (rows(SEEN, lambda lines: [line.replace(",0,", ",0.5,") for line in lines]), "is not an id"),
    "an empty cell": (last_cell(""), "is not a finite number"),
    "nan": (last_cell("nan"), "is not a finite number"),
    "a text": (last_cell("near"), "is not a finite number"),
    "negative ranges": (scaled(SEEN, range=-1), "the range is negative"),
    "range and bearing exchanged": (header(SEEN, "range,bearing", "bearing,range"), "the range is negative"),
    "no text": (text(SEEN, lambda t: t.replace("s", "\0s")), "not a text in UTF-8"),
    "a line cut short": (text(SEEN, lambda t: t[:-12]), "columns where the first line has"),
}


def written(folder: Path, files: Mapping[str, str | bytes]) -> Path:
    for name, content in files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def read_if(outcome: str, folder: Path) -> Imported | None:
    """Read a log whose `outcome` is to be read without a line; otherwise it has a line with this text, and is None."""
    try:
        with redirect_stderr(io.StringIO()) as printed:
            log = read_csv_log(folder)
        said = "\n".join([*printed.getvalue().splitlines(), *log.notes, *examine(log, folder).warnings])
    except UserError as error:
        log, said = None, str(error)
        assert len(said.splitlines()) == 1
    if outcome != READ:
        assert outcome in said
        return None
    assert said == ""
    assert log is not None
    return log


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
    for field in ("stamps", "odometry", "observation", "odometry_cov", "observation_cov"):
        assert_allclose(getattr(log.recording, field), getattr(expected.recording, field), rtol=1e-5, atol=1e-6)
    assert_array_equal(log.recording.landmark, expected.recording.landmark)


def test_a_unit_that_makes_lengths_smaller_than_their_noise_is_not_suggested(tmp_path: Path) -> None:
    """Ranges in feet over 3 s agree with one place per landmark once all lengths are divided by 100 or 1000."""
    _, recording = simulate(load_scenario("q1-short-dense", ["trajectory.duration=3"]), 3)
    log = Imported(replace(recording, observation=recording.observation * [3.28, 1.0]))
    assert "check units" in " ".join(examine(log, tmp_path).warnings)
