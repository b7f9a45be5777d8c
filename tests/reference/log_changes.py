"""One good log of a robot in CSV files, and changes of its files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from slamgauge.arrays import Float
from slamgauge.se2 import compose, exp

Files = dict[str, str]
Change = Callable[[Files], Files]
Text = Callable[[str], str]
Column = Callable[[Float], Float]
SETTINGS = "[noise]\nper = 'speed'\nforward = 0.05\nlateral = 0.01\nturn = 0.02\nrange = 0.05\nbearing = 0.02\n"
LANDMARKS = np.array([[2.0, 3.0], [-2.0, 4.0], [4.0, -1.0], [-3.0, -2.0], [0.5, 6.0], [6.0, 4.0]])
ODOMETRY, SEEN, TRUTH, MAP, MAPPING = "odometry.csv", "observations.csv", "truth.csv", "landmarks.csv", "recording.toml"
ALL = (ODOMETRY, SEEN, TRUTH)


def good_log(seed: int = 8, steps: int = 300, noise: float = 1.0) -> Files:
    """Return steps of 0.1 s of a robot that drives arcs of both directions, with 0.5 m/s and up to 0.35 rad/s.

    Args:
        seed: Of the noise.
        steps: Number of steps.
        noise: Factor from the stated standard deviations of the sensor to those that are drawn.
    """
    rng = np.random.default_rng(seed)
    rows = steps + 1
    stamps = 1000.0 + 0.1 * np.arange(rows)
    speeds = np.column_stack([np.full(rows, 0.5), np.zeros(rows), np.where(np.arange(rows) % 120 < 80, 0.35, -0.2)])
    driven = speeds + rng.normal(size=(rows, 3)) * [0.05, 0.01, 0.02]
    poses = [np.zeros(3)]
    for each in driven[:-1]:
        poses.append(compose(poses[-1], exp(0.1 * each)))
    odometry = ["stamp,v,omega", *(f"{t:.3f},{v:.6f},{w:.6f}" for t, (v, _, w) in zip(stamps, speeds, strict=True))]
    seen = ["stamp,landmark,range,bearing"]
    for stamp, pose in zip(stamps[::3], poses[::3], strict=True):
        for name, (x, y) in enumerate(LANDMARKS - pose[:2]):
            distance = np.hypot(x, y) + noise * rng.normal(0, 0.05)
            bearing = np.arctan2(y, x) - pose[2] + noise * rng.normal(0, 0.02)
            if distance < 6.0:
                seen.append(f"{stamp:.3f},{name},{distance:.6f},{np.angle(np.exp(1j * bearing)):.6f}")
    path = [f"{t:.3f},{x:.6f},{y:.6f},{h:.6f}" for t, (x, y, h) in zip(stamps, poses, strict=True)]
    texts = {ODOMETRY: odometry, SEEN: seen, TRUTH: ["stamp,x,y,theta", *path]}
    return {name: "\n".join(lines) + "\n" for name, lines in texts.items()} | {MAPPING: SETTINGS}


def every(*files: str, change: Text) -> Change:
    """Change the text of files."""
    return lambda given: given | {file: change(given[file]) for file in files}


def text(file: str, change: Text) -> Change:
    """Change the text of a file."""
    return every(file, change=change)


def header(file: str, old: str, new: str) -> Change:
    """Replace a part of the header."""
    return text(file, lambda content: content.replace(old, new, 1))


def settings(lines: str) -> Change:
    """Add lines to the settings."""
    return text(MAPPING, lambda content: content + lines)


def both(*changes: Change) -> Change:
    """Make several changes."""

    def change(files: Files) -> Files:
        for each in changes:
            files = each(files)
        return files

    return change


def rows(file: str, change: Callable[[list[str]], list[str]]) -> Change:
    """Change the lines below the header."""

    def changed(content: str) -> str:
        head, *lines = content.splitlines()
        return "\n".join([head, *change(lines)]) + "\n"

    return text(file, changed)


def cells(file: str, change: Callable[[list[str]], list[str]]) -> Change:
    """Change the cells of each line."""
    return text(
        file, lambda content: "".join(f"{','.join(change(line.split(',')))}\n" for line in content.splitlines())
    )


def words(file: str, at: int, change: Text) -> Change:
    """Change a cell of each row below the header."""
    return rows(
        file,
        lambda lines: [",".join(change(w) if n == at else w for n, w in enumerate(line.split(","))) for line in lines],
    )


def table(file: str, change: Callable[[dict[str, Float]], dict[str, Float]]) -> Change:
    """Replace the columns of a file by those that `change` returns."""

    def changed(content: str) -> str:
        names, *lines = (line.split(",") for line in content.splitlines())
        columns = change(dict(zip(names, np.array(lines, dtype=np.float64).T, strict=True)))
        values = np.column_stack([*columns.values()]).tolist()
        return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in values)]) + "\n"

    return text(file, changed)


def column(file: str, name: str, change: Column) -> Change:
    """Change a column."""
    return table(file, lambda columns: columns | {name: change(columns[name])})


def scaled(file: str, **factors: float) -> Change:
    """Multiply columns of a file."""
    return table(file, lambda each: each | {name: factor * each[name] for name, factor in factors.items()})


def moved(file: str, name: str, by: float) -> Change:
    """Add to a column, which keeps its digits."""
    return column(file, name, lambda values: values + by)


def some(value: float, every_nth: int = 10) -> Column:
    """Replace every n-th value."""
    return lambda values: np.where(np.arange(len(values)) % every_nth == 3, value, values)
