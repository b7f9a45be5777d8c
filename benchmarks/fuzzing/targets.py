"""Inputs of slamgauge: a valid example of each, ways to damage it, its reader, and a check of the result.

The check of an accepted input does not use the reader's code:

* files with checksums (npz, compressed MATLAB files) and changed bytes: the result is that of the undamaged file;
* npz files that were written again with other arrays: every number is the one that numpy reads in the file;
* text files and other MATLAB files have no checksums: every value of an observation, and of a motion and a pose if the
  format has them without conversion, is in the file, angles up to whole turns, except poses interpolated to a step;
* scenarios: each key has the value of the TOML text;
* stores of studies: every row is the stored one, and no row is missing without a message.
"""

from __future__ import annotations

import contextlib
import io
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from fuzzing.mutations import WORDS, Mutation, changed_bytes, changed_mat, changed_npz, changed_pages, changed_text
from slamgauge import Estimate, Recording, Truth, load_scenario, simulate
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.compare.datasets.victoria_park import read_victoria_park
from slamgauge.compare.storage.csv_folder import read_recording_csv, write_estimate_csv, write_recording_csv
from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth, save, write_tum
from slamgauge.compare.storage.interpolation import SAME
from slamgauge.compare.storage.result_files import STORE
from slamgauge.compare.storage.stored_results import load_stored
from slamgauge.compare.studies.study import load_runs, run_study
from slamgauge.ekf import FilterSettings
from slamgauge.ekf.estimators import ekf_slam
from slamgauge.se2 import wrap
from tests.reference import robot_logs

Files = Mapping[str, bytes]
Read = Callable[[Path], Any]  # folder of the files to the result
Check = Callable[[Path, Any], str]  # folder and result to the difference between them, "" if none
Stored = dict[tuple[str, int], tuple[Any, ...]]  # figures and series by estimator and run

SCENARIO = """\
extends = "q1-short-dense"
description = "a short way"
start = "mean"

[prior]
mean = [0.0, 0.0, 0.5]
variances = [0.01, 0.01, 0.0001]

[trajectory]
speed = 1.0
yaw_rate = 0.1
duration = 3.0

[sensor]
max_range = 8.0
field_of_view_deg = 200.0

[association]
method = "nearest-neighbour"
gate = 9.0

[landmarks.random]
count = 12
box = [-5.0, -5.0, 5.0, 5.0]
seed = 3
"""
KEYS = (
    *("sensor.max_range", "sensor.field_of_view_deg", "sensor.kind", "trajectory.duration", "trajectory.speed"),
    *("prior.mean", "prior.variances", "association.gate", "association.method", "association.node_limit"),
    *("fis.beta", "fis.alpha", "fis.s_min", "fis.s_max", "delayed.poses", "initialisation"),
    *(
        "landmarks.random.count",
        "landmarks.random",
        "motion.slip_rate",
        "sensor.clutter_rate",
        "assumed.scale",
        "start",
    ),
    *("update.robust", "update.gate", "description", "name", "a.b", "trajectory", "", "landmarks.positions"),
)
PARK = """\
ODOMETRY 0 1 1.0 0.0 0.1 0.01 0.0 0.0 0.02 0.001 0.003
ODOMETRY 1 3 0.9 0.1 0.2 0.01 0.0 0.0 0.02 0.001 0.003
LANDMARK 0 2 3.0 1.0 0.04 0.0 0.05
LANDMARK 3 2 2.0 0.4 0.1 0.01 0.5
LANDMARK 3 4 -2.0 0.4 0.1 0.01 0.5
"""


RUNS, NAMES = 4, ("dead-reckoning", "ekf")  # stored study


@dataclass(frozen=True)
class Target:
    """An input.

    Attributes:
        name: title in the table.
        files: contents of valid files by name.
        read: function of slamgauge that reads a folder with the files.
        mutations: ways to damage a file that has no checksum.
        sealed: mutations that a checksum finds, so that the result of an accepted file is that of the undamaged file.
        check: a further check of the result.
    """

    name: str
    files: Files
    read: Read
    mutations: tuple[Mutation, ...] = (changed_text, changed_text, changed_text, changed_bytes)
    sealed: tuple[Mutation, ...] = ()
    check: Check = field(default=lambda _folder, _result: "")


@cache
def targets(folder: Path) -> tuple[Target, ...]:
    """Return all inputs; `folder` is an empty one for temporary files."""
    (folder / "short.toml").write_text(SCENARIO)
    scenario = load_scenario(folder / "short.toml", ["association.method=known"])
    truth, recording = simulate(scenario, 0)
    estimate = ekf_slam(recording)
    texts = _texts(folder, recording, estimate)
    return (*_npz_files(folder, truth, recording, estimate), *_mat_files(), *texts, _study(scenario, folder))


# --- files with checksums ----------------------------------------------------------------------


def _npz_files(folder: Path, truth: Truth, recording: Recording, estimate: Estimate) -> list[Target]:
    made: list[Target] = []
    bearings = load_scenario("q4-three-landmarks", ["trajectory.duration=2.0"])
    records: dict[str, tuple[Recording | Truth | Estimate, Read]] = {
        "recording npz": (recording, load_recording),
        "truth npz": (truth, load_truth),
        "estimate npz": (estimate, load_estimate),
        "rays npz": (ekf_slam(simulate(bearings, 0)[1], FilterSettings(frames=3)), load_estimate),
    }
    for name, (record, load) in records.items():
        save(folder / "record.npz", record)
        files = {"record.npz": (folder / "record.npz").read_bytes()}
        read = partial(_read_file, load, "record.npz")
        made.append(Target(name, files, read, (changed_npz,), (changed_bytes,), _as_numpy_reads))
    return made


def _read_file(load: Read, name: str, folder: Path) -> Any:
    return load(folder / name)


def _as_numpy_reads(folder: Path, record: object) -> str:
    """Compare every array of a record with the one that numpy reads in the file."""
    with np.load(folder / "record.npz") as archive:
        given = {name: archive[name] for name in archive}
    for name, value in _leaves(record).items():
        if name not in given:
            return f"{name} is not in the file" if np.size(value) else ""
        if isinstance(value, str):
            same = value == str(given[name])
        else:
            there = given[name].astype(np.float64)
            same = _are_same(np.asarray(value, dtype=np.float64), there, name)
        if not same:
            return f"{name} is not what the file has"
    return ""


def _are_same(value: NDArray[Any], there: NDArray[Any], name: str) -> bool:
    """Compare exactly, headings up to whole turns, covariances up to the rounding that makes them symmetric."""
    if name.endswith("_cov") and there.ndim == 2:  # one covariance for all rows
        there = np.broadcast_to(there, value.shape)
    if value.shape != there.shape:
        return False
    if name.endswith(("cov", "covs")):
        return np.allclose(value, there / 2 + there.swapaxes(-1, -2) / 2, rtol=1e-15, atol=0.0)
    if name == "poses":
        there = np.column_stack([there[:, :2], wrap(there[:, 2])])
    return np.array_equal(value, there, equal_nan=True)


def _leaves(record: object, within: str = "") -> dict[str, Any]:
    """Return the fields of a record that are not None; names of nested records become prefixes."""
    found: dict[str, Any] = {}
    for each in fields(cast("Any", record)):
        value = getattr(record, each.name)
        if is_dataclass(value):
            found |= _leaves(value, f"{each.name}_")
        elif value is not None:
            found[within + each.name] = value
    return found


def _mat_files() -> list[Target]:
    column = np.linspace(0.1, 0.9, 6)[:, None]
    woods: dict[str, Any] = dict.fromkeys(("v", "om", "x_true", "y_true", "th_true"), column)
    woods |= {"t": 0.1 * np.arange(6.0)[:, None], "true_valid": np.ones((6, 1), np.uint8)}
    woods |= {"r": column @ [[2.0, 3.0]], "b": column @ [[-1.0, 0.5]], "l": np.array([[1.0, 2.0], [3.0, -4.0]])}
    woods |= dict.fromkeys(("d", "r_var", "b_var", "v_var", "om_var"), 0.01)
    compressed, plain = io.BytesIO(), io.BytesIO()
    savemat(compressed, woods, do_compression=True)
    savemat(plain, woods)
    read, name = partial(_read_file, read_lost_in_the_woods, "dataset2.mat"), "dataset2.mat"
    sealed = Target(
        "mat compressed", {name: compressed.getvalue()}, read, (changed_mat,), (changed_bytes,), _as_scipy_reads
    )
    # a plain file has no checksum, and scipy may crash on it
    return [sealed, Target("mat plain", {name: plain.getvalue()}, read, (changed_bytes,))]


def _as_scipy_reads(folder: Path, result: tuple[Recording, Truth]) -> str:
    there = loadmat(folder / "dataset2.mat", variable_names=("r", "l", "t"))  # others may be damaged
    recording, truth = result
    ranges = there["r"][(there["r"] > 0) & (there["r"] <= 5.0)]
    pairs = (
        (recording.observation[:, 0], ranges),
        (np.asarray(truth.landmarks), there["l"]),
        (recording.stamps, there["t"].ravel()),
    )
    return "" if all(np.array_equal(*pair) for pair in pairs) else "it is not what scipy reads"


# --- texts -------------------------------------------------------------------------------------


def _texts(folder: Path, recording: Recording, estimate: Estimate) -> list[Target]:
    (folder / "own").mkdir(exist_ok=True)
    write_recording_csv(folder / "own", recording)
    write_estimate_csv(folder / "own/estimate.csv", estimate)
    write_tum(folder / "own/estimate.tum", recording.stamps, estimate.poses, estimate.pose_covs)
    own = {path.name: path.read_bytes() for path in (folder / "own").iterdir()}

    def stored(name: str) -> Read:
        return lambda folder: load_stored(folder / name, recording)

    toml = {"short.toml": SCENARIO.encode()}
    both, path = partial(_compare, ("observation", "odometry")), partial(_compare, ("poses", "landmarks"))
    positions = partial(_compare_positions, recording.stamps)
    texts = [
        Target("csv folder", _some(own, "start", "odometry", "observations"), read_recording_csv, check=both),
        Target("estimate csv", _some(own, "estimate.csv", "landmarks"), stored("estimate.csv"), check=path),
        Target("estimate tum", _some(own, "estimate.tum"), stored("estimate.tum"), check=positions),
        Target(
            "victoria park", {"log.txt": PARK.encode()}, partial(_read_file, read_victoria_park, "log.txt"), check=both
        ),
        Target("toml", toml, _simulated, check=_as_tomllib_reads),
        Target("--set", {"set": b"sensor.max_range=3", **toml}, _simulated, (_other_override,)),
    ]
    for name, (files, read) in LOGS.items():
        content = {file: text.encode() for file, text in files.items()}
        texts.append(Target(name, content, read, check=_compare_log))
    return texts


LOGS: dict[str, tuple[Mapping[str, str], Read]] = {
    "csv log": (robot_logs.CSV, lambda folder: read_csv_log(folder).recording),
    "g2o": (robot_logs.G2O, lambda folder: read_g2o(folder / "graph.g2o").recording),
    "toro": (
        robot_logs.TORO,
        lambda folder: read_g2o(folder / "graph.toro", isam=True, drop_loop_edges=True).recording,
    ),
    "mrclam": (robot_logs.MRCLAM, lambda folder: read_mrclam(folder).recording),
}


def _some(files: Files, *begins: str) -> Files:
    return {name: content for name, content in files.items() if name.startswith(begins)}


def _numbers_in(folder: Path) -> NDArray[np.float64]:
    """Return the sorted absolute values of all numbers in the files of a folder, also wrapped as angles."""
    numbers: list[float] = [0.0]
    for path in folder.iterdir():
        for word in re.split(r"[\s,;\"=]+", path.read_text(encoding="utf-8", errors="replace")):
            with contextlib.suppress(ValueError):
                numbers.append(float(word))
    found = np.array([number for number in numbers if math.isfinite(number)])
    return np.unique(np.abs(np.concatenate([found, wrap(found)])))


def _not_in_files(folder: Path, name: str, array: NDArray[np.float64]) -> str:
    written, sizes = _numbers_in(folder), np.abs(array).ravel()
    after = np.searchsorted(written, sizes).clip(max=len(written) - 1)
    apart = np.minimum(np.abs(written[after] - sizes), np.abs(written[np.maximum(after - 1, 0)] - sizes))
    if (apart > 1e-9 * (1.0 + sizes)).any():
        return f"{name} {array.ravel()[int(np.argmax(apart))]} is not in the file"
    return ""


def _compare(names: tuple[str, ...], folder: Path, record: Recording | Estimate) -> str:
    differences = (_not_in_files(folder, name, getattr(record, name)) for name in names)
    return next(filter(None, differences), "")


def _compare_log(folder: Path, recording: Recording) -> str:
    mapping = folder / "recording.toml"
    if mapping.exists() and mapping.read_bytes() != robot_logs.CSV["recording.toml"].encode():
        return ""  # the damaged file may give other units
    return _compare(("observation",), folder, recording)


def _compare_positions(stamps: NDArray[np.float64], folder: Path, estimate: Estimate) -> str:
    """Compare the positions of steps whose stamps are in the file; those of other steps are interpolated."""
    written = _numbers_in(folder)
    given = np.array([np.abs(written - stamp).min() <= SAME for stamp in stamps])
    return _not_in_files(folder, "poses", estimate.poses[given, :2])


# --- scenarios and stores ----------------------------------------------------------------------


def _simulated(folder: Path) -> Any:
    override = folder / "set"
    overrides = [override.read_text(encoding="utf-8")] if override.exists() else []
    scenario = load_scenario(folder / "short.toml", overrides)
    simulate(scenario, 0)
    return scenario


def _other_override(_: bytes, rng: np.random.Generator) -> bytes:
    return f"{rng.choice(KEYS)}={rng.choice(WORDS)}".encode(errors="replace")


def _as_tomllib_reads(folder: Path, scenario: Any) -> str:
    """Compare the keys of a scenario with those of the text; keys with other names are not compared."""
    given = tomllib.loads((folder / "short.toml").read_text(encoding="utf-8"))
    return _different(given, scenario.model_dump())


def _different(given: Mapping[str, Any], taken: Mapping[str, Any], place: str = "") -> str:
    for key, value in given.items():
        if key not in taken:
            continue
        there = taken[key]
        if isinstance(value, Mapping) and isinstance(there, Mapping):
            found = _different(value, there, f"{place}{key}.")
            if found:
                return found
        elif not isinstance(value, Mapping) and not _is_same(value, there):
            return f"{place}{key} is {there!r:.60}, not {value!r:.60}"
    return ""


def _is_same(value: Any, there: Any) -> bool:
    if isinstance(value, list):
        return len(value) == len(there) and all(_is_same(*pair) for pair in zip(value, there, strict=True))
    if isinstance(value, int) and isinstance(there, float):  # an integer in TOML may have more digits
        return float(value) == there
    return value == there or isinstance(there, Mapping)


def _study(scenario: Any, folder: Path) -> Target:
    """Return the store of a short study."""
    with ThreadPoolExecutor(1) as thread, contextlib.redirect_stderr(io.StringIO()):
        run_study(scenario, RUNS, 0, NAMES, folder / "study", thread)
    files = {STORE: (folder / "study" / STORE).read_bytes()}
    check = partial(_as_stored, _read_study(scenario, folder / "study"))
    return Target("study.sqlite", files, partial(_read_study, scenario), (changed_pages,), check=check)


def _read_study(scenario: Any, folder: Path) -> Stored:
    stored: Stored = {}
    for name, runs in load_runs(scenario, RUNS, 0, NAMES, folder).items():
        for row, run in enumerate(runs.run.tolist()):
            figures = [values[row] for key, values in runs.figures.items() if "seconds" not in key]
            stored[name, run] = (runs.kind, repr(figures), *(values[row].tobytes() for values in runs.series.values()))
    return stored


def _as_stored(whole: Stored, _: Path, found: Stored) -> str:
    other = [key for key, value in found.items() if whole.get(key) != value]
    if other:
        return f"{other[0]} is not what was stored"
    return "" if len(found) == len(whole) else f"{len(found)} rows of {len(whole)} without a message"
