"""The inputs: a whole one of each, how it may be damaged, how slamgauge takes it, and what is claimed if it does.

What is claimed of something that was accepted is what can be told without the reader's own code:

* bytes under a sum of check (npz, compressed MATLAB files): the result is that of the undamaged file;
* npz files that were written again: every number is the one that numpy reads there;
* texts and other MATLAB files: every value of an observation, and of a motion and a pose where the format holds them as
  they are, stands in the file, angles up to whole turns. Texts have no sums of check: what they say is what counts;
* scenarios: a key has the value that the TOML text gives it, and `--set` has changed its own section alone.
"""

from __future__ import annotations

import io
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from fuzzing.mutations import WORDS, Mutation, changed_bytes, changed_mat, changed_npz, changed_text
from fuzzing.stores import damaged_stores
from slamgauge import Estimate, Recording, Truth, load_scenario, simulate
from slamgauge.compare.datasets.csv_log import read_csv_log
from slamgauge.compare.datasets.dlr import read_dlr
from slamgauge.compare.datasets.freiburg import read_freiburg
from slamgauge.compare.datasets.g2o import read_g2o
from slamgauge.compare.datasets.lost_in_the_woods import read_lost_in_the_woods
from slamgauge.compare.datasets.mrclam import read_mrclam
from slamgauge.compare.datasets.victoria_park import read_victoria_park
from slamgauge.compare.storage.csv_folder import read_recording_csv, write_estimate_csv, write_recording_csv
from slamgauge.compare.storage.files import load_estimate, load_recording, load_truth, save, write_tum
from slamgauge.compare.storage.stored_results import load_stored
from slamgauge.ekf import FilterSettings
from slamgauge.ekf.estimators import ekf_slam
from slamgauge.se2 import wrap
from tests.reference import robot_logs

Files = Mapping[str, bytes]
Claim = Callable[[Path, Any], str]  # folder and result: what is not as the file says, nothing if all is

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
    *("fis.beta", "fis.alpha", "fis.s_min", "fis.s_max", "inverse_depth.mean", "delayed.poses", "initialisation"),
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


@dataclass(frozen=True)
class Target:
    """An input.

    Attributes:
        name: what it is called in the table.
        files: whole ones, by name.
        take: what slamgauge makes of a folder with them.
        mutations: each leaves a file that must say for itself what is in it.
        sealed: mutations that a sum of check finds, so that what is accepted is what was there before.
        claim: what else is claimed of the result.
    """

    name: str
    files: Files
    take: Callable[[Path], Any]
    mutations: tuple[Mutation, ...] = (changed_text, changed_text, changed_text, changed_bytes)
    sealed: tuple[Mutation, ...] = ()
    claim: Claim = field(default=lambda _folder, _result: "")


@cache
def targets(folder: Path) -> tuple[Target, ...]:
    """All of them; `folder` is an empty one to make whole files in."""
    truth, recording = simulate(_short_scenario(folder), 0)
    estimate = ekf_slam(recording)
    stores = [Target(**each) for each in damaged_stores(_short_scenario(folder), folder)]
    texts = _texts(folder, recording, estimate)
    return (*_npz_files(folder, truth, recording, estimate), *_mat_files(), *texts, *stores)


def _short_scenario(folder: Path) -> Any:
    (folder / "short.toml").write_text(SCENARIO)
    return load_scenario(folder / "short.toml", ["association.method=known"])


# --- files with sums of check ------------------------------------------------------------------


def _npz_files(folder: Path, truth: Truth, recording: Recording, estimate: Estimate) -> list[Target]:
    made: list[Target] = []
    bearings = load_scenario("q4-three-landmarks", ["trajectory.duration=2.0"])
    records: dict[str, tuple[Recording | Truth | Estimate, Callable[[Path], Any]]] = {
        "recording npz": (recording, load_recording),
        "truth npz": (truth, load_truth),
        "estimate npz": (estimate, load_estimate),
        "rays npz": (ekf_slam(simulate(bearings, 0)[1], FilterSettings(frames=3)), load_estimate),
    }
    for name, (record, load) in records.items():
        save(folder / "record.npz", record)
        files = {"record.npz": (folder / "record.npz").read_bytes()}
        take = partial(_in_folder, load, "record.npz")
        mutations = ((changed_npz,), (changed_bytes,))
        made.append(Target(name, files, take, *mutations, claim=_as_numpy_reads))
    return made


def _in_folder(load: Callable[[Path], Any], name: str, folder: Path) -> Any:
    return load(folder / name)


def _as_numpy_reads(folder: Path, record: object) -> str:
    """Whether every array of a record is, number for number, what numpy reads in the file."""
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
            return f"{name} is not what the file holds"
    return ""


def _are_same(value: NDArray[Any], there: NDArray[Any], name: str) -> bool:
    """Exactly; headings up to whole turns, covariances up to the rounding that makes them symmetric."""
    if name.endswith("_cov") and there.ndim == 2:  # one stands for all rows
        there = np.broadcast_to(there, value.shape)
    if value.shape != there.shape:
        return False
    if name.endswith(("cov", "covs")):
        return np.allclose(value, there / 2 + there.swapaxes(-1, -2) / 2, rtol=1e-15, atol=0.0)
    if name == "poses":
        there = np.column_stack([there[:, :2], wrap(there[:, 2])])
    return np.array_equal(value, there, equal_nan=True)


def _leaves(record: object, within: str = "") -> dict[str, Any]:
    """The fields of a record that are not None; those of a record within it follow its name."""
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
    take = partial(_in_folder, read_lost_in_the_woods, "dataset2.mat")
    made: list[Target] = []
    for name, is_compressed in (("mat compressed", True), ("mat plain", False)):
        file = io.BytesIO()
        savemat(file, woods, do_compression=is_compressed)
        files = {"dataset2.mat": file.getvalue()}
        if is_compressed:
            made.append(Target(name, files, take, (changed_mat,), (changed_bytes,), _as_scipy_reads))
        else:  # nothing tells that its bytes were others, and scipy may end the interpreter at them
            made.append(Target(name, files, take, (changed_bytes,)))
    return made


def _as_scipy_reads(folder: Path, result: tuple[Recording, Truth]) -> str:
    there = loadmat(folder / "dataset2.mat")
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
    logs = {name: {file: text.encode() for file, text in vars(robot_logs)[name].items()} for name in LOGS}
    stored = partial(_stored, recording)
    texts = [
        Target("csv folder", _some(own, "start", "odometry", "observations"), read_recording_csv, claim=_says_all),
        Target(
            "estimate csv", _some(own, "estimate.csv", "landmarks"), partial(stored, "estimate.csv"), claim=_says_path
        ),
        Target("estimate tum", _some(own, "estimate.tum"), partial(stored, "estimate.tum"), claim=_says_xy),
        Target("victoria park", {"log.txt": PARK.encode()}, _park, claim=_says_all),
        Target("toml", {"short.toml": SCENARIO.encode()}, _from_toml, claim=_as_tomllib_reads),
        Target("--set", {"set": b"sensor.max_range=3", "short.toml": SCENARIO.encode()}, _from_set, (_other_override,)),
    ]
    return texts + [Target(LOGS[name][0], logs[name], LOGS[name][1], claim=_says_observations) for name in LOGS]


LOGS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "CSV": ("csv log", lambda folder: read_csv_log(folder).recording),
    "G2O": ("g2o", lambda folder: read_g2o(folder / "graph.g2o").recording),
    "TORO": ("toro", lambda folder: read_g2o(folder / "graph.toro", isam=True, drop_loop_edges=True).recording),
    "MRCLAM": ("mrclam", lambda folder: read_mrclam(folder).recording),
    "DLR": ("dlr", lambda folder: read_dlr(folder / "log.txt").recording),
    "FREIBURG": ("freiburg", lambda folder: read_freiburg(folder).recording),
}


def _some(files: Files, *begins: str) -> Files:
    return {name: content for name, content in files.items() if name.startswith(begins)}


def _park(folder: Path) -> Recording:
    return read_victoria_park(folder / "log.txt")


def _stored(recording: Recording, name: str, folder: Path) -> Estimate:
    return load_stored(folder / name, recording)


def _said(folder: Path) -> NDArray[np.float64]:
    """The sizes of all numbers in the files of a folder, and of angles up to whole turns, in order."""
    numbers: list[float] = [0.0]
    for path in folder.iterdir():
        for word in re.split(r"[\s,;\"=]+", path.read_text(encoding="utf-8", errors="replace")):
            try:
                numbers.append(float(word))
            except ValueError:
                continue
    said = np.array([number for number in numbers if math.isfinite(number)])
    return np.unique(np.abs(np.concatenate([said, wrap(said)])))


def _unsaid(folder: Path, **values: NDArray[np.float64]) -> str:
    said = _said(folder)
    for name, array in values.items():
        sizes = np.abs(array).ravel()
        after = np.searchsorted(said, sizes).clip(max=len(said) - 1)
        apart = np.minimum(np.abs(said[after] - sizes), np.abs(said[np.maximum(after - 1, 0)] - sizes))
        if (apart > 1e-9 * (1.0 + sizes)).any():
            return f"{name} {array.ravel()[int(np.argmax(apart))]} does not stand in the file"
    return ""


def _says_observations(folder: Path, recording: Recording) -> str:
    mapping = folder / "recording.toml"
    if mapping.exists() and mapping.read_bytes() != robot_logs.CSV["recording.toml"].encode():
        return ""  # it may ask for other units
    return _unsaid(folder, observation=recording.observation)


def _says_all(folder: Path, recording: Recording) -> str:
    return _unsaid(folder, observation=recording.observation, odometry=recording.odometry)


def _says_path(folder: Path, estimate: Estimate) -> str:
    return _unsaid(folder, poses=estimate.poses, landmarks=estimate.landmarks)


def _says_xy(folder: Path, estimate: Estimate) -> str:
    return _unsaid(folder, poses=estimate.poses[:, :2])


# --- scenarios ---------------------------------------------------------------------------------


def _from_toml(folder: Path) -> Any:
    scenario = load_scenario(folder / "short.toml")
    simulate(scenario, 0)
    return scenario


def _from_set(folder: Path) -> Any:
    scenario = load_scenario(folder / "short.toml", [(folder / "set").read_text(encoding="utf-8")])
    simulate(scenario, 0)
    return scenario


def _other_override(_: bytes, rng: np.random.Generator) -> bytes:
    return f"{rng.choice(KEYS)}={rng.choice(WORDS)}".encode(errors="replace")


def _as_tomllib_reads(folder: Path, scenario: Any) -> str:
    """Whether keys of the scenario have the values that the text gives them; those under other names are left out."""
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
    if isinstance(value, int) and isinstance(there, float):  # a whole number of TOML may have more digits
        return float(value) == there
    return value == there or isinstance(there, Mapping)
