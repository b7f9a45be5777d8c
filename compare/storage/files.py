"""Results on disk: npz files of the vocabulary, TUM trajectories, JSON."""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from slamgauge.arrays import Float, chunks
from slamgauge.compare.storage.covariance_columns import upper_triangles
from slamgauge.compare.storage.npz_file import NONE_KNOWN, read_npz
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Recording
from slamgauge.truth import Truth

Record = TypeVar("Record", Recording, Truth, Estimate)

LONGEST_WORD = 40  # characters
RECORDS_WITHIN: set[type[object]] = {RayLog, MapHistory}  # records that are fields of an `Estimate`


@contextmanager
def explained(path: str | Path, verb: str) -> Generator[None]:
    """Turn the operating system's refusal to have `path` "read" or "written" into a one-line `UserError`."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{path}: cannot be {verb} ({reason}); check the path and its permissions") from None


@contextmanager
def of_this_version(path: Path) -> Generator[None]:
    """Turn the failure to find what this version writes into `path` in its content into a one-line `UserError`."""
    try:
        yield
    except (LookupError, TypeError, AttributeError):
        raise UserError(f"{path}: of another version, or changed by hand; give its command again") from None


def save(path: str | Path, record: Recording | Truth | Estimate) -> None:
    """Write the fields of a record to an npz file under their own names; a field that is None is left out.

    The fields of a record within the record get its name before theirs: `rays_birth`.

    Raises:
        UserError: If the file cannot be written.
    """
    with explained(path, "written"), Path(path).open("wb") as file:
        np.savez_compressed(file, **flat_fields(record))


def flat_fields(record: object) -> dict[str, Any]:
    """The fields of a record by name, without those that are None; those of a record within it follow its own name."""
    values: dict[str, Any] = {}
    for field in fields(record):  # pyright: ignore[reportArgumentType]
        value = getattr(record, field.name)
        if is_dataclass(value):
            values |= {f"{field.name}_{name}": inner for name, inner in flat_fields(value).items()}
        elif value is not None:
            values[field.name] = value
    return values


def load_recording(path: str | Path) -> Recording:
    """The recording of an npz file; `UserError` with path and remedy if it holds none."""
    return _load(path, Recording)


def load_truth(path: str | Path, recording: Recording | None = None) -> Truth:
    """The truth of an npz file; `UserError` with path and remedy if it holds none.

    Its association is the recording's own array of ids where they are the same.
    """
    return _load(path, Truth, recording)


def load_estimate(path: str | Path, recording: Recording | None = None) -> Estimate:
    """The estimate of an npz file; `UserError` with path and remedy if it holds none.

    Its association is the recording's own array of ids where they are the same.
    """
    return _load(path, Estimate, recording)


def load_recording_or_estimate(path: str | Path) -> Recording | Estimate:
    """Whichever of the two an npz file holds; `UserError` with path and remedy if it holds neither."""
    values = _read(path)
    return _made(path, Estimate if "kind" in values else Recording, values)


def write_tum(path: str | Path, stamps: Float, poses: Float, covs: Float | None = None) -> None:
    """Write a trajectory in the TUM format of evo: `t x y z qx qy qz qw`, without the gaps (rows of NaN).

    With covariances their upper triangles follow (xx xy xt yy yt tt), as `stored_estimates` reads them; evo does not.

    Args:
        path: The text file.
        stamps: (N+1,) [s].
        poses: (N+1, 3) x [m], y [m], heading [rad].
        covs: (N+1, 3, 3) of the poses.

    Raises:
        UserError: If the file cannot be written.
    """
    with explained(path, "written"), Path(path).open("w", encoding="ascii") as file:
        for rows in chunks(len(poses)):
            table = _tum_rows(stamps[rows], poses[rows], None if covs is None else covs[rows])
            file.writelines(f"{' '.join(map(repr, row.tolist()))}\n" for row in table)


def _tum_rows(stamps: Float, poses: Float, covs: Float | None) -> Float:
    x, y, heading = poses.T
    zero = np.zeros_like(x)
    rows = np.column_stack([stamps, x, y, zero, zero, zero, np.sin(heading / 2), np.cos(heading / 2)])
    if covs is not None:
        rows = np.column_stack([rows, upper_triangles(covs)])
    return rows[~np.isnan(poses).any(axis=1)]


def write_json(path: Path, content: object) -> None:
    """Write JSON as all our results are written; `UserError` if the file cannot be written."""
    with explained(path, "written"), path.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=2, allow_nan=False)  # piece by piece: a long run has megabytes of loop closures
        file.write("\n")


def read_json(path: Path, command: str) -> Any:
    """The content of a file that `slamgauge COMMAND` has written.

    Raises:
        UserError: it cannot be read, or holds no JSON.
    """
    with explained(path, "read"):
        text = path.read_bytes()
    try:
        return json.loads(text)
    except ValueError:
        raise UserError(f"{path}: not what `slamgauge {command}` writes; run it again") from None


def _load(path: str | Path, kind: type[Record], recording: Recording | None = None) -> Record:
    ids = None if recording is None else recording.landmark
    return _made(path, kind, _read(path, {} if ids is None else {"association": ids}))


def _made(path: str | Path, kind: type[Any], values: dict[str, Any], within: str = "") -> Any:
    """The record of the file's `values`; `within` is what stands before its fields' names in the file."""
    hints = get_type_hints(kind)
    for field, hint in hints.items():
        for inner in RECORDS_WITHIN & {*get_args(hint)}:
            begin = f"{field}_"
            parts = {name.removeprefix(begin): values.pop(name) for name in [*values] if name.startswith(begin)}
            if parts:
                values[field] = _made(path, inner, parts, begin)
    optional = {name for name, hint in hints.items() if NoneType in get_args(hint)}
    defaults = {each.name for each in fields(kind) if (each.default, each.default_factory) != (MISSING, MISSING)}
    required = hints.keys() - optional - defaults
    for verdict, names in (("lacks", required - values.keys()), ("has the unknown", values.keys() - hints.keys())):
        if names:
            found = f"it {verdict} {', '.join(sorted(f'{within}{name}' for name in names))}"
            raise UserError(f"{path}: not a {kind.__name__}, {found}; give another file")
    texts = {field: _word(path, field, values[field]) for field, hint in hints.items() if get_origin(hint) is Literal}
    arguments: dict[str, Any] = dict.fromkeys(optional) | values | texts
    try:
        return kind(**arguments)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _word(path: str | Path, field: str, value: Any) -> str:
    word = str(value) if np.ndim(value) == 0 else ""
    if not 0 < len(word) <= LONGEST_WORD:
        raise UserError(f"{path}: {field} is no word; give another file")
    return word


def _read(path: str | Path, known: Mapping[str, NDArray[Any]] = NONE_KNOWN) -> dict[str, Any]:
    with explained(path, "read"):
        return read_npz(Path(path), known)
