"""Read and write results: npz files of recordings, truths and estimates; TUM trajectories; JSON."""

from __future__ import annotations

import errno
import json
import lzma
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from slamgauge.arrays import Float, chunks
from slamgauge.compare.storage.covariance_columns import upper_triangles
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.notices import tell_once
from slamgauge.recording import Recording
from slamgauge.truth import Truth

Record = TypeVar("Record", Recording, Truth, Estimate)

LONGEST_WORD = 40  # characters
DAMAGED = (  # errors of zipfile and numpy at damaged or foreign files
    *(ValueError, TypeError, AttributeError, EOFError, LookupError, OverflowError, MemoryError, RuntimeError),
    *(SyntaxError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError),
)
RECORDS_WITHIN: set[type[object]] = {RayLog, MapHistory}  # records inside an `Estimate`


@contextmanager
def explained(path: str | Path, verb: str) -> Generator[None]:
    """Turn an `OSError` of the block into a one-line `UserError`; `verb` is "read" or "written"."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        full = errno.errorcode.get(error.errno or 0) in ("ENOSPC", "EDQUOT")
        remedy = "make room, and give the same command again" if full else "check the path and its permissions"
        raise UserError(f"{path}: cannot be {verb} ({reason}); {remedy}") from None


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark.

    Raises:
        UserError: it cannot be read, or is not a text; with the line.
    """
    with explained(path, "read"):
        content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
        broken = text.find("\0")
    except UnicodeDecodeError as error:
        text, broken = "", error.start
    if broken >= 0:
        line = 1 + content.count(b"\n", 0, broken)
        raise UserError(f"{path}, line {line}: not a text in UTF-8; give another file, or save it as such")
    return text


def tell_if_cut(path: Path, text: str) -> None:
    """Print a notice if the last line of a text has no line end: a number that is cut short is still a number."""
    if text.strip() and not text.endswith(("\n", "\r")):
        last = text.splitlines()[-1][-LONGEST_WORD:]
        tell_once(f"{path}: no line end after {last!r}: the file may be cut; check this number and add a line end")


@contextmanager
def of_this_version(path: Path) -> Generator[None]:
    """Turn a missing key or wrong type in the content of `path` into a one-line `UserError`."""
    try:
        yield
    except UserError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError):
        raise UserError(f"{path}: written by another version, or changed by hand; run its command again") from None


def save(path: str | Path, record: Recording | Truth | Estimate) -> None:
    """Write the fields of a record that have a value to an npz file.

    Fields of an inner record are prefixed with its name: `rays_birth`.

    Raises:
        UserError: If the file cannot be written.
    """
    with explained(path, "written"), Path(path).open("wb") as file:
        np.savez_compressed(file, **flat_fields(record))


def flat_fields(record: object) -> dict[str, Any]:
    """Return the fields of a record that have a value; fields of an inner record are prefixed with its name."""
    values: dict[str, Any] = {}
    for field in fields(record):  # pyrefly: ignore[bad-argument-type]
        value = getattr(record, field.name)
        if is_dataclass(value):
            values |= {f"{field.name}_{name}": inner for name, inner in flat_fields(value).items()}
        elif value is not None:
            values[field.name] = value
    return values


def load_recording(path: str | Path) -> Recording:
    """Load a recording from an npz file; raise `UserError` if the file does not contain one."""
    return _load(path, Recording)


def load_truth(path: str | Path, recording: Recording | None = None) -> Truth:
    """Load a truth from an npz file; raise `UserError` if the file does not contain one.

    If its association equals `recording.landmark`, both share one array.
    """
    return _load(path, Truth, recording)


def load_estimate(path: str | Path, recording: Recording | None = None) -> Estimate:
    """Load an estimate from an npz file; raise `UserError` if the file does not contain one.

    If its association equals `recording.landmark`, both share one array.
    """
    return _load(path, Estimate, recording)


def load_recording_or_estimate(path: str | Path) -> Recording | Estimate:
    """Load a recording or an estimate from an npz file; raise `UserError` if the file contains neither."""
    values = _read(path)
    return _made(path, Estimate if "kind" in values else Recording, values)


def write_tum(path: str | Path, stamps: Float, poses: Float, covs: Float | None = None) -> None:
    """Write a trajectory in the TUM format of evo: `t x y z qx qy qz qw`, without rows of NaN.

    With covariances each line continues with the upper triangle (xx xy xt yy yt tt); `stored_results` reads these
    lines, evo does not.

    Args:
        path: Text file.
        stamps: Times (N+1,) [s].
        poses: Poses (N+1, 3): x [m], y [m], heading [rad].
        covs: Covariances (N+1, 3, 3) of the poses.

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
    """Write `content` as indented JSON; raise `UserError` if the file cannot be written."""
    with explained(path, "written"), path.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=2, allow_nan=False)  # streamed: a long run has megabytes of loop closures
        file.write("\n")


def read_json(path: Path, command: str) -> Any:
    """Return the content of a JSON file that `slamgauge COMMAND` wrote.

    Raises:
        UserError: If the file cannot be read or is not JSON.
    """
    with explained(path, "read"):
        text = path.read_bytes()
    try:
        return json.loads(text)
    except ValueError:
        raise UserError(f"{path}: not what `slamgauge {command}` writes; run it again") from None


def _load(path: str | Path, kind: type[Record], recording: Recording | None = None) -> Record:
    values = _read(path)
    ids = None if recording is None else recording.landmark
    if ids is not None and "association" in values and np.array_equal(values["association"], ids):
        values["association"] = ids
    return _made(path, kind, values)


def _made(path: str | Path, kind: type[Any], values: dict[str, Any], within: str = "") -> Any:
    """Build a record from the `values` of a file; `within` is the prefix of its field names in the file."""
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
    texts = {field: str(values[field]) for field, hint in hints.items() if get_origin(hint) is Literal}
    arguments: dict[str, Any] = dict.fromkeys(optional) | values | texts
    try:
        return kind(**arguments)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def _read(path: str | Path) -> dict[str, Any]:
    """Return the arrays of an npz file by name, read-only, so that records need no copies; pickles are refused."""
    with explained(path, "read"):
        try:
            with np.load(path, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        except DAMAGED:
            raise UserError(f"{path}: not a whole npz file of plain arrays; write it again with numpy.savez") from None
    for array in arrays.values():
        array.setflags(write=False)
    return arrays
