"""Messages between slamgauge and a process with user code: a line of JSON, then an npz file if one follows.

What user code answers is compared field by field with what it may contain: the process may have been taken over.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from slamgauge.compare.estimators.sources import Sources
from slamgauge.compare.estimators.user_code import Address, UserCodeError
from slamgauge.compare.storage.files import flat_fields, load_estimate, load_recording
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

LONGEST_HEADER = 100_000  # bytes
LONGEST_TEXT = 1000  # characters
MOST_REMARKS = 100
MOST_BYTES = 500_000_000  # largest estimate
FOLLOWING = "bytes"  # key of the size of what follows
PIPES = "leave the pipes that it is given alone"


class Spent(NamedTuple):
    """Elapsed time and processor time of a run in the child process [s]."""

    seconds: float
    cpu_seconds: float


class Answer(NamedTuple):
    """A message: its fields, and the npz file that follows."""

    fields: dict[str, Any]
    content: bytes

    @property
    def reason(self) -> str:
        """Why a result is missing; empty if it exists."""
        return self.text("reason")

    def text(self, key: str) -> str:
        """Return a field as one printable line; empty if it is missing."""
        value = self.fields.get(key, "")
        if not isinstance(value, str):
            raise wrong(f"{key} is not a text")
        return printable(value)

    def texts(self, key: str) -> list[str]:
        """Return a list of texts."""
        values = self.fields.get(key, [])
        if not isinstance(values, list) or len(values) > MOST_REMARKS or not all(isinstance(v, str) for v in values):
            raise wrong(f"{key} is not a short list of texts")
        return [printable(each) for each in values]

    def flag(self, key: str) -> bool:
        """Return a field that is true or false; false if it is missing."""
        value = self.fields.get(key, False)
        if not isinstance(value, bool):
            raise wrong(f"{key} is not true or false")
        return value

    def spent(self, elapsed: float) -> Spent:
        """Return the times of a run that took at most `elapsed` seconds."""
        most = Spent(elapsed, elapsed * (os.cpu_count() or 1) + 1.0)
        for key, limit in most._asdict().items():
            value = self.fields.get(key)
            if not isinstance(value, int | float) or isinstance(value, bool) or not 0.0 <= value <= limit:
                raise wrong(f"{key} is not from 0 to {limit:.3g} s")
        return Spent(*(float(self.fields[key]) for key in Spent._fields))

    def estimate(self) -> Estimate:
        """Return the estimate that follows.

        Raises:
            UserCodeError: it is not an estimate, or too large.
        """
        try:
            with zipfile.ZipFile(BytesIO(self.content)) as archive:
                size = sum(each.file_size for each in archive.infolist())
        except (zipfile.BadZipFile, OSError, ValueError):  # numpy reads an npy file of whatever size its header states
            raise wrong("its estimate is not an npz file") from None
        if size > MOST_BYTES:
            raise UserCodeError(f"its estimate has {size / 1e6:.0f} MB; keep it below {MOST_BYTES / 1e6:.0f} MB")
        with tempfile.NamedTemporaryFile(prefix="slamgauge-", suffix=".npz") as file:
            file.write(self.content)
            file.flush()
            try:
                return load_estimate(file.name)
            except UserError as error:
                raise UserCodeError(str(error).removeprefix(f"{file.name}: ")) from None


def wrong(what: str) -> UserCodeError:
    """Return the error of an answer that slamgauge's own code would not write."""
    return UserCodeError(f"its process wrote a wrong answer ({what}); {PIPES}")


def printable(text: object) -> str:
    """Return a text of user code without control characters, which terminals obey and XML excludes, and shortened."""
    shown = "".join(each if each.isprintable() else " " for each in str(text or "")[:LONGEST_TEXT])
    return " ".join(shown.split())


def message(fields: Mapping[str, object], record: Recording | Estimate | None = None) -> bytes:
    """Return a message as bytes."""
    content = BytesIO()
    if record is not None:
        np.savez(content, **flat_fields(record))
    return json.dumps({**fields, FOLLOWING: content.tell()}).encode() + b"\n" + content.getvalue()


class Incoming:
    """Messages that arrive in pieces."""

    def __init__(self) -> None:
        self._fields: dict[str, Any] | None = None
        self._data = bytearray()

    def add(self, piece: bytes) -> Answer | None:
        """Add a piece; return the first message if it is whole, and keep what follows for the next call.

        Raises:
            UserCodeError: it is not a message, or too long.
        """
        self._data += piece
        if self._fields is None:
            line, end, _ = self._data.partition(b"\n")
            if len(line) > LONGEST_HEADER:
                raise wrong("too long a line")
            if not end:
                return None
            self._fields = _fields(line)
            del self._data[: len(line) + 1]
        size = _following(self._fields)
        if len(self._data) < size:
            return None
        answer = Answer(self._fields, bytes(self._data[:size]))
        self._fields = None
        del self._data[:size]
        return answer


def address_fields(where: Address) -> dict[str, object]:
    """Return an address as JSON can contain it."""
    sources = where.sources
    if sources is None:
        return where._asdict()
    files = [(path, content.decode("latin-1")) for path, content in sources.files]
    return {**where._asdict(), "sources": {"folder": sources.folder, "module": sources.module, "files": files}}


def read_address(requests: IO[bytes]) -> Address:
    """Read the address of user code from a pipe."""
    return address_of(_fields(requests.readline()))


def address_of(fields: dict[str, Any]) -> Address:
    """Return the address with some `address_fields`."""
    sources = fields["sources"]
    if sources is not None:
        files = tuple((path, text.encode("latin-1")) for path, text in sources["files"])
        fields["sources"] = Sources(sources["folder"], sources["module"], files)
    fields["strangers"] = tuple(fields["strangers"])
    return Address(*(fields[name] for name in Address._fields))


def read_recording(requests: IO[bytes]) -> Recording | None:
    """Read a recording from a pipe; None at its end. The temporary folder must belong to this process alone."""
    line = requests.readline()
    if not line:
        return None
    file = Path(tempfile.gettempdir(), "given.npz")
    file.write_bytes(requests.read(_following(_fields(line))))
    recording = load_recording(file)
    file.unlink()
    return recording


def _fields(line: bytes | bytearray) -> dict[str, Any]:
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        raise wrong("not a line of JSON") from None
    if not isinstance(fields, dict):
        raise wrong("not a JSON object")
    return fields


def _following(fields: Mapping[str, Any]) -> int:
    size = fields.get(FOLLOWING)
    if type(size) is not int or size < 0:
        raise wrong(f"{FOLLOWING} is not a size")
    if size > MOST_BYTES:
        raise UserCodeError(f"its estimate has {size / 1e6:.0f} MB; keep it below {MOST_BYTES / 1e6:.0f} MB")
    return size
