"""Read and write results: npz files of records, folders of runs, JSON, CSV, TOML and MATLAB files.

A file that cannot be read or written, or that another program wrote, is a `UserError` of one line.
"""

from __future__ import annotations

import csv
import errno
import json
import lzma
import re
import struct
import tokenize
import tomllib
import zipfile
import zlib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, TextIO, TypeVar

import numpy as np

from slamgauge.compare.storage.result_files import METRICS, RECORDING, TRUTH, shown
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate, MapHistory, RayLog
from slamgauge.recording import Recording
from slamgauge.truth import Truth, require_same_run

Record = TypeVar("Record", Recording, Truth, Estimate)
Table = dict[str, Any]

DAMAGED = (  # errors of zipfile and numpy at damaged or foreign files
    *(ValueError, TypeError, AttributeError, EOFError, LookupError, OverflowError, MemoryError, RuntimeError),
    *(SyntaxError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError),
)
RECORDS_WITHIN = {"rays": RayLog, "history": MapHistory}  # fields of an `Estimate`
FORMULA = re.compile(r"(?![-+]?[\d.]+(e[-+]?\d+)?\Z)'*[=+\-@\t\r]")  # numbers, which begin with - too, are excluded


@contextmanager
def explained(path: str | Path, verb: str) -> Generator[None]:
    """Turn an `OSError` of the block into a one-line `UserError`; `verb` is "read" or "written"."""
    try:
        yield
    except OSError as error:
        full = errno.errorcode.get(error.errno or 0) in ("ENOSPC", "EDQUOT")
        remedy = "make room, and give the same command again" if full else "check the path and its permissions"
        raise UserError(f"{path}: cannot be {verb} ({error.strerror or error}); {remedy}") from None


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark; an error names the line."""
    with explained(path, "read"):
        content = path.read_bytes()
    broken = content.find(b"\0")
    if broken < 0:
        try:
            return content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            broken = error.start
    line = 1 + content.count(b"\n", 0, broken)
    raise UserError(f"{path}, line {line}: not a text in UTF-8; give another file, or save it as such")


@contextmanager
def of_this_version(path: Path) -> Generator[None]:
    """Turn a missing key or wrong type in the content of `path` into a one-line `UserError`."""
    try:
        yield
    except UserError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError):
        what = f"{path}: written by another version, or changed by hand"
        raise UserError(f"{what}; move it away, and run its command again") from None


# --- records and folders of results ---------------------------------------------------------------


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
    return _made(path, Estimate, values) if "kind" in values else _made(path, Recording, values)


def _made(path: str | Path, kind: type[Record], values: dict[str, Any]) -> Record:
    """Build a record from the `values` of a file."""
    if kind is Recording:
        values.setdefault("landmark", None)
    try:
        for name, inner in RECORDS_WITHIN.items() if kind is Estimate else ():
            begin = f"{name}_"
            parts = {each.removeprefix(begin): values.pop(each) for each in [*values] if each.startswith(begin)}
            if parts:
                values[name] = inner(**parts)
        return kind(**values)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    except TypeError as error:  # names the fields that are missing or unknown
        raise UserError(f"{path}: not a whole {kind.__name__}: {error}; give another file") from None


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
    return {name: str(array) if array.dtype.kind == "U" else array for name, array in arrays.items()}


class Results(NamedTuple):
    """Results of `slamgauge run` or `evaluate --out`; estimates by name, in the order of the command."""

    title: str
    truth: Truth | None
    recording: Recording
    estimates: dict[str, Estimate]


def load_results(folder: Path) -> Results:
    """Read the results in a folder; raise `UserError` if it has none, or if its files belong to different runs."""
    path = folder / METRICS
    if not path.is_file():
        what = f"not a folder of results, it has no {METRICS}"
        raise UserError(f"{folder}: {what}; give one that `slamgauge run` or `slamgauge evaluate --out` has written")
    metrics = read_json(path)
    with of_this_version(path):
        names, scenario, seed = list(metrics["estimators"]), metrics["scenario"], metrics["seed"]
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


def write_mat(path: Path, records: Mapping[str, Recording | Truth | Estimate]) -> None:
    """Write one struct of arrays per record into a MATLAB file.

    Fields and shapes are those of Python: covariances are (rows, d, d), and steps count from 0. Fields without a value
    are omitted. Names of estimates become identifiers: letters, digits and underscores, beginning with a letter.
    """
    from scipy.io import savemat  # imported here because it is slow and only this format needs it

    structs: dict[str, dict[str, Any]] = {}
    for name, record in records.items():
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        structs[plain if plain[:1].isalpha() else f"x{plain}"] = flat_fields(record)
    with explained(path, "written"):
        savemat(path, structs, appendmat=False, long_field_names=True, oned_as="column")


# --- JSON and CSV ---------------------------------------------------------------------------------


def write_json(path: Path, content: object) -> None:
    """Write `content` as indented JSON."""
    with explained(path, "written"):
        path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_json(path: Path) -> Any:
    """Return the content of a JSON file that slamgauge wrote."""
    with explained(path, "read"), of_this_version(path):
        return json.loads(path.read_bytes())


def write_csv(file: TextIO, rows: Iterable[Iterable[object]]) -> None:
    """Write rows to a text file that was opened with `newline=""`; formulas get an apostrophe in front."""
    writer = csv.writer(file, lineterminator="\n")
    for row in rows:
        writer.writerow([f"'{cell}" if _is_formula(cell) else cell for cell in row])


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read rows below a header that `write_csv` wrote, as they were."""
    with explained(path, "read"), path.open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    for row in rows:
        row.update({key: text[1:] for key, text in row.items() if text[:1] == "'" and _is_formula(text[1:])})
    return rows


def _is_formula(cell: object) -> bool:
    """Return whether a cell begins like what a spreadsheet evaluates, behind apostrophes or not; numbers do not."""
    return isinstance(cell, str) and FORMULA.match(cell) is not None


# --- TOML -----------------------------------------------------------------------------------------


def read_toml(path: Path) -> Table:
    """Return the tables of a TOML file; raise `UserError` with the line if it is not valid."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of numbers and brackets beyond the limits of Python
        raise UserError(f"{path}: not valid TOML: {error}; correct that line") from None


def override(table: Table, text: str) -> None:
    """Set one `dotted.key=value` in the table; missing sections are created.

    The value is parsed as TOML; if that fails, it is taken as a string.
    """
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise UserError(f"{text[:100]}: not an override; write dotted.key=value")
    *sections, key = path.strip().split(".")
    for section in sections:
        if not isinstance(table.get(section), dict):
            table[section] = {}
        table = table[section]
    try:
        table[key] = tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):  # also of a number with more digits than Python reads
        table[key] = value.strip()


def write_toml(path: Path, sections: Mapping[str, Mapping[str, Any]]) -> None:
    """Write sections as a TOML file (see `toml_text`)."""
    with explained(path, "written"):
        path.write_text(toml_text(sections), encoding="utf-8")


def toml_text(sections: Mapping[str, Mapping[str, Any]]) -> str:
    """Return sections as TOML without their None values; section "" has the keys before all other sections."""
    lines: list[str] = []
    for name, section in sections.items():
        keys = [f"{key} = {_value(value)}" for key, value in section.items() if value is not None]
        lines += [*([f"[{name}]"] if name else []), *keys, ""]
    return "\n".join(lines)


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{json.dumps(key)} = {_value(each)}' for key, each in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)
