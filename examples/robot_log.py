"""Write the log of a simulated robot in the form of a real one: `python examples/robot_log.py my-log`.

The wheels give speed [m/s] and yaw rate [deg/s] ten times a second. A laser gives ranges [m] and bearings [deg] to
reflectors four times a second, not synchronised with the wheels. The written recording.toml states the noise.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from slamgauge import chain, wrap

SECONDS, WHEELS, LASER = 120.0, 0.1, 0.25  # s: duration, and time between two rows of a file
SPEED, YAW_RATE = 0.5, 8.0  # m/s, deg/s
MOTION_SIGMAS = np.array([0.05, 0.01, np.radians(1.0)])  # noise of the speeds: forward, sideways, turn
RANGE_SIGMA, BEARING_SIGMA = 0.05, 1.0  # m, deg
REACH = 6.0  # m
BEGINNING = 1000.0  # s: time of the robot's clock at the start

MAPPING = """\
[odometry]
file = "wheels.csv"
angle = "deg"
columns = { stamp = "time", v = "speed", omega = "yaw_rate" }

[observations]
file = "laser.csv"
angle = "deg"
columns = { stamp = "time", landmark = "reflector" }

[noise]  # metres and radians, for speeds per second
per = "speed"
forward = 0.05
lateral = 0.01
turn = 0.0175
range = 0.05
bearing = 0.0175
"""


def main(folder: Path) -> None:
    """Write the log, the description of its files, and the truth."""
    rng = np.random.default_rng(15)
    steps = round(SECONDS / WHEELS)
    commanded = np.tile([SPEED, 0.0, np.radians(YAW_RATE)], (steps, 1)) * np.array([1.0, 0.0, 1.0])
    commanded[:, 2] *= np.sign(
        np.sin(np.arange(steps) * WHEELS * np.radians(YAW_RATE) / 2.0) + 1e-9
    )  # a figure of eight
    poses = chain(np.zeros(3), arcs(WHEELS * (commanded + rng.normal(size=(steps, 3)) * MOTION_SIGMAS)))
    stamps = BEGINNING + WHEELS * np.arange(steps + 1)
    reflectors = poses[:: steps // 12, :2] + rng.uniform(-3.0, 3.0, (13, 2))

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "recording.toml").write_text(MAPPING, encoding="utf-8")
    speeds = zip(stamps, np.append(commanded[:, 0], 0.0), np.degrees(np.append(commanded[:, 2], 0.0)), strict=True)
    write(folder / "wheels.csv", ("time", "speed", "yaw_rate"), speeds)
    sights = laser(rng, stamps, poses, reflectors)
    write(folder / "laser.csv", ("time", "reflector", "range", "bearing"), sights)
    write(folder / "truth.csv", ("stamp", "x", "y", "theta"), np.column_stack([stamps, poses]))
    write(folder / "landmarks.csv", ("landmark", "x", "y"), ([at, *place] for at, place in enumerate(reflectors)))


def arcs(twists: np.ndarray) -> np.ndarray:
    """Return the increments (n, 3) of constant speeds with forward, lateral and turning components (n, 3)."""
    x, y, turn = twists.T
    half = np.exp(0.5j * turn) * np.sinc(0.5 * turn / np.pi)  # (e^it - 1) / it
    moved = (x + 1j * y) * half
    return np.column_stack([moved.real, moved.imag, turn])


def laser(
    rng: np.random.Generator, stamps: np.ndarray, poses: np.ndarray, reflectors: np.ndarray
) -> Iterable[Sequence[float]]:
    """Yield the observations of the laser: time, reflector, range and bearing."""
    for time in np.arange(stamps[0] + 0.03, stamps[-1], LASER):
        heading = np.interp(time, stamps, np.unwrap(poses[:, 2]))
        here = np.array([np.interp(time, stamps, poses[:, axis]) for axis in (0, 1)])
        for at, (dx, dy) in enumerate((reflectors - here).tolist()):
            if np.hypot(dx, dy) < REACH:
                distance = float(np.hypot(dx, dy)) + rng.normal(0.0, RANGE_SIGMA)
                bearing = float(np.degrees(wrap(np.arctan2(dy, dx) - heading))) + rng.normal(0.0, BEARING_SIGMA)
                yield float(time), at, distance, bearing


def write(path: Path, header: Sequence[str], rows: Iterable[Sequence[float]]) -> None:
    """Write a CSV file with six decimals."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([value if isinstance(value, int) else f"{value:.6f}" for value in row] for row in rows)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "my-log"))
