"""Messages between slamgauge and a process with user code: a line of JSON, then an npz file if one follows.

What user code answers is compared field by field with what it may contain: the process may have been taken over.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from io import BytesIO
from typing import IO, Any, NamedTuple

import numpy as np

from slamgauge.compare.estimators.user_errors import FormError, UserCodeError, WrongCovarianceError
from slamgauge.compare.storage.files import flat_fields, load_estimate, load_recording
from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

LONGEST_HEADER = 1_000_000  # bytes
LONGEST_TEXT = 1000  # characters
MOST_TEXTS = 100
MOST_BYTES = 500_000_000  # largest estimate
FOLLOWING = "bytes"  # key of the size of what follows


class Answer(NamedTuple):
    """A message: its fields, and the npz file that follows."""

    fields: dict[str, Any]
    content: bytes

    @property
    def error(self) -> UserCodeError | None:
        """Why a result is missing; None if it exists."""
        if refusal := self.texts("refusal", keeps_indent=True):
            return FormError("\n".join(refusal))
        reason = self.text("reason")
        kind = WrongCovarianceError if self.flag("is_wrong_covariance") else UserCodeError
        return kind(reason) if reason else None

    def text(self, key: str) -> str:
        """Return a field as one printable line; empty if it is missing."""
        value = self.fields.get(key, "")
        if not isinstance(value, str):
            raise wrong(f"{key} is not a text")
        return printable(value)

    def texts(self, key: str, *, keeps_indent: bool = False) -> list[str]:
        """Return a list of texts, each one printable line."""
        values = self.fields.get(key, [])
        if not isinstance(values, list) or len(values) > MOST_TEXTS or not all(isinstance(v, str) for v in values):
            raise wrong(f"{key} is not a short list of texts")
        indents = [len(each) - len(each.lstrip(" ")) if keeps_indent else 0 for each in values]
        return [" " * indent + printable(each) for indent, each in zip(indents, values, strict=True)]

    def flag(self, key: str) -> bool:
        """Return a field that is true or false; false if it is missing."""
        value = self.fields.get(key, False)
        if not isinstance(value, bool):
            raise wrong(f"{key} is not true or false")
        return value

    def seconds(self, elapsed: float) -> float:
        """Return the time of a run that took at most `elapsed` seconds."""
        value = self.fields.get("seconds")
        if not isinstance(value, int | float) or isinstance(value, bool) or not 0.0 <= value <= elapsed:
            raise wrong(f"seconds is not from 0 to {elapsed:.3g} s")
        return float(value)

    def estimate(self) -> Estimate:
        """Return the estimate that follows; raise `UserCodeError` if it is not one, or too large."""
        file: Any = BytesIO(self.content)
        try:
            with zipfile.ZipFile(file) as archive:
                _require_size(sum(each.file_size for each in archive.infolist()))
        except (zipfile.BadZipFile, OSError):  # numpy reads an npy file of whatever size its header states
            raise wrong("its estimate is not an npz file") from None
        try:
            return load_estimate(file)
        except UserError as error:
            raise UserCodeError(str(error).removeprefix(f"{file}: ")) from None


def wrong(what: str) -> UserCodeError:
    """Return the error of an answer that slamgauge's own code would not write."""
    return UserCodeError(f"its process wrote a wrong answer ({what}); leave the pipes that it is given alone")


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


def read_answer(stream: IO[bytes]) -> Answer | None:
    """Read a message from a pipe, None at its end; raise `UserCodeError` if it is not one, or too long."""
    line = stream.readline(LONGEST_HEADER + 1)
    if len(line) > LONGEST_HEADER:
        raise wrong("too long a line")
    if not line.endswith(b"\n"):
        return None
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        raise wrong("not a line of JSON") from None
    if not isinstance(fields, dict):
        raise wrong("not a JSON object")
    size = fields.get(FOLLOWING)
    if type(size) is not int or size < 0:
        raise wrong(f"{FOLLOWING} is not a size")
    _require_size(size)
    content = stream.read(size)
    return Answer(fields, content) if len(content) == size else None


def read_request(stream: IO[bytes]) -> tuple[dict[str, Any], Recording | None] | None:
    """Read a request from a pipe: its fields, and the recording that follows; None at the end of the pipe."""
    request = read_answer(stream)
    if request is None:
        return None
    file: Any = BytesIO(request.content)
    return request.fields, load_recording(file) if request.content else None


def _require_size(size: int) -> None:
    if size > MOST_BYTES:
        raise UserCodeError(f"its estimate has {size / 1e6:.0f} MB; keep it below {MOST_BYTES / 1e6:.0f} MB")
