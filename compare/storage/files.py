"""Read and write results: npz files of records, folders of runs, JSON, CSV and MATLAB files."""

from __future__ import annotations

import csv
import errno
import json
import lzma
import re
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Literal, NamedTuple, TextIO, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from slamgauge.compare.storage.result_files import METRICS, RECORDING, TRUTH, shown
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run

Record = TypeVar("Record", Recording, Truth, Estimate)

DAMAGED = (  # errors of zipfile and numpy at damaged or foreign files
    *(ValueError, TypeError, AttributeError, EOFError, LookupError, OverflowError, MemoryError, RuntimeError),
    *(SyntaxError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError),
)
RECORDS_WITHIN: set[type[object]] = {RayLog, MapHistory}  # records inside an `Estimate`
FORMULA = re.compile(r"'*[=+\-@\t\r]")  # begins texts that spreadsheets evaluate, or that have an apostrophe already
LONGEST_FIELD = 63  # characters of a field's name in a MATLAB file


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
    return _made(path, Recording, _arrays(path))


def load_truth(path: str | Path) -> Truth:
    """Load a truth from an npz file; raise `UserError` if the file does not contain one."""
    return _made(path, Truth, _arrays(path))


def load_estimate(path: str | Path) -> Estimate:
    """Load an estimate from an npz file; raise `UserError` if the file does not contain one."""
    return _made(path, Estimate, _arrays(path))


def load_recording_or_estimate(path: str | Path) -> Recording | Estimate:
    """Load a recording or an estimate from an npz file; raise `UserError` if the file contains neither."""
    values = _arrays(path)
    return _made(path, Estimate if "kind" in values else Recording, values)


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


def _arrays(path: str | Path) -> dict[str, Any]:
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


class Results(NamedTuple):
    """Results of `slamgauge run` or `evaluate --out`; estimates by name, in the order of the command."""

    title: str
    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]


def load_results(folder: Path) -> Results:
    """Read the results in a folder.

    Raises:
        UserError: If the folder has no results, or its files belong to different runs.
    """
    path = folder / METRICS
    if not path.is_file():
        what = f"not a folder of results, it has no {METRICS}"
        raise UserError(f"{folder}: {what}; give one that `slamgauge run` or `slamgauge evaluate --out` has written")
    metrics = read_json(path, "run")
    with of_this_version(path):
        names, scenario, seed = list(metrics["estimators"]), metrics["scenario"], metrics["seed"]
    if not names:
        raise UserError(f"{path}: contains no estimators; run the command again with at least one")
    recording = load_recording(folder / RECORDING)
    truth = load_truth(folder / TRUTH) if (folder / TRUTH).exists() else None
    require_same_run(truth, recording)
    estimates = {name: load_estimate(folder / f"estimates/{name}.npz") for name in names}
    for name, estimate in estimates.items():
        if len(estimate.poses) != recording.steps + 1:
            what = f"{len(estimate.poses)} poses, but the recording in this folder needs {recording.steps + 1}"
            raise UserError(f"{folder / 'estimates' / name}.npz: {what}; run the command again")
    title = shown(folder.resolve().name if scenario is None else f"{scenario}, seed {seed}")
    return Results(title, truth, recording, estimates)


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


def write_csv(file: TextIO, rows: Iterable[Iterable[object]]) -> None:
    """Write rows to a text file that was opened with `newline=""`.

    A text that a spreadsheet would evaluate as a formula gets an apostrophe in front.
    """
    csv.writer(file, lineterminator="\n").writerows([_guarded(cell) for cell in row] for row in rows)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read rows below a header that `write_csv` wrote, as they were; raise `UserError` if the file cannot be read."""
    with explained(path, "read"), path.open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    return [
        {key: text[1:] if text[:1] == "'" and FORMULA.match(text) else text for key, text in row.items()}
        for row in rows
    ]


def _guarded(cell: object) -> object:
    """Return a cell, with an apostrophe in front of a text that begins like a formula and is not a number."""
    if not isinstance(cell, str) or not FORMULA.match(cell):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def write_mat(path: Path, records: Mapping[str, Recording | Truth | Estimate]) -> None:
    """Write one struct of arrays per record into a MATLAB file; raise `UserError` if it cannot be written.

    Fields and shapes are those of Python: covariances are (rows, d, d), and steps count from 0. Fields without a value
    are omitted. Names of estimates become identifiers: letters, digits and underscores, beginning with a letter.
    """
    from scipy.io import savemat  # imported here because it is slow and only this format needs it

    structs: dict[str, dict[str, Any]] = {}
    for name, record in records.items():
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        structs[plain[:LONGEST_FIELD]] = flat_fields(record)
    with explained(path, "written"), path.open("wb") as file:
        savemat(file, structs, long_field_names=True, oned_as="column")
