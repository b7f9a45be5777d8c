"""Lines of users' text files with their places, so that each error names file and line.

Files are UTF-8, with any line ends. Text after a # and empty lines are ignored.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import read_text, tell_if_cut
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

LARGEST_ID = 2**53  # not every larger whole number is a float64
REMARKS = ("#", "%")  # first characters of lines of tables that are remarks, or names of columns
NOTHING: Mapping[str, str] = {}
PATIENCE = 2.0  # seconds of reading before a terminal shows progress


@dataclass(frozen=True, slots=True)
class Line:
    """A line: its file, its number from 1, and its words."""

    path: Path
    number: int
    words: list[str]

    def refused(self, what: str, remedy: str) -> UserError:
        """Return the error for a mistake in the line."""
        return UserError(f"{self.path}, line {self.number}: {what}; {remedy}")

    def require(self, form: str) -> None:
        """Refuse the line unless it has as many words as its form, for example `TAG i j x y`."""
        if len(self.words) != len(form.split()):
            raise self.refused(f"has {len(self.words)} words, not {len(form.split())}", f"write {form}")

    def numbers(self, first: int) -> list[float]:
        """Return the words from place `first` on as numbers, see `number_at`."""
        return [self.number_at(at) for at in range(first, len(self.words))]

    def number_at(self, at: int) -> float:
        """Return the word at a place as a number; refuse it if it is not finite or larger than `LARGEST`."""
        number = _number(self.words[at])
        if not abs(number) < LARGEST:
            raise self.refused(f"{self.words[at][:40]!r} is not a finite number", "correct it, or remove the line")
        return number

    def id_at(self, at: int, least: int = 0) -> int:
        """Return the word at a place as a whole number, `least` or more; 3.0 is one, too."""
        number = _number(self.words[at])
        if not number.is_integer() or not least <= number < LARGEST_ID:
            raise self.refused(f"{self.words[at][:40]!r} is not an id", f"give a whole number from {least} below 2**53")
        return int(number)


def shown_stamp(seconds: float) -> str:
    """Return a stamp [s] with all its digits, at most nine behind the point."""
    return f"{seconds:.9f}".rstrip("0").rstrip(".")


def _number(word: str) -> float:
    """Return a word as a number, NaN if it is not a number; 1_0 may be a name, and is not 10."""
    try:
        return math.nan if "_" in word else float(word)
    except ValueError:
        return math.nan


def read_lines(path: Path, *, comment: str = "#", separators: str = "") -> Iterator[Line]:
    """Yield the lines of a text file that are not empty; if it takes long, a terminal shows progress.

    Args:
        path: The file.
        comment: Begins a remark that ends with its line; "" for none.
        separators: Characters that may separate words, which may be quoted. The first of them in the first line that
            does not begin with # or % is used; if it has none of them, white space is.

    Raises:
        UserError: the file cannot be read, or is not a text.
    """
    content = read_text(path)
    tell_if_cut(path, content)
    text = io.StringIO(content, newline=None)
    first = next((line for line in text if line.strip() and line.lstrip()[0] not in REMARKS), "")
    separator = next((each for each in separators if each in first), None)
    text.seek(0)
    shown = tqdm(text, desc=path.name, delay=PATIENCE, disable=None, leave=False, unit="line")
    for number, line in enumerate(shown, start=1):
        words = line.partition(comment)[0] if comment else line
        if words.strip():
            yield Line(path, number, [word.strip() for word in _split(words, separator)])


def _split(content: str, separator: str | None) -> list[str]:
    """Return the words of a line; those between separators may be quoted."""
    if separator is None:
        return content.split()
    return next(csv.reader([content], delimiter=separator, skipinitialspace=True))


def read_table(path: Path, form: str) -> tuple[list[Line], Float]:
    """Read a file of numbers only; return its lines and the numbers (n, k) of its k columns.

    Args:
        path: The file.
        form: Names of the columns, for example `time x y`.

    Raises:
        UserError: the file cannot be read or has no lines, or a line does not have the form.
    """
    lines = list(read_lines(path))
    for line in lines:
        line.require(form)
    if not lines:
        raise UserError(f"{path}: no line in it; write lines of {form}")
    return lines, np.array([line.numbers(0) for line in lines])


def read_tagged(
    path: Path, forms: Mapping[str, str], unsupported: Mapping[str, str] = NOTHING
) -> dict[str, list[Line]]:
    """Read the lines of a file by their first word, the tag.

    Args:
        path: The file.
        forms: Form of the lines of each tag, for example `SENSOR id range bearing`; "" allows any number of words.
        unsupported: What lines of further tags contain, which are refused.

    Raises:
        UserError: the file cannot be read, a tag is unknown, or a line does not have the form of its tag.
    """
    lines: dict[str, list[Line]] = {tag: [] for tag in forms}
    for line in read_lines(path):
        tag = line.words[0]
        if tag in unsupported:
            raise line.refused(f"{tag} is {unsupported[tag]}, which is not supported", "leave such lines out")
        if tag not in forms:
            raise line.refused(f"{tag[:30]!r} is an unknown tag", did_you_mean(tag[:30], forms))
        if forms[tag]:
            line.require(forms[tag])
        lines[tag].append(line)
    return lines


def require_order(lines: Sequence[Line], stamps: Float, *, strict: bool) -> None:
    """Refuse the first line whose stamp [s] is before that of the line above, or equal to it if `strict`."""
    steps = np.diff(stamps)
    wrong = steps <= 0.0 if strict else steps < 0.0
    if wrong.any():
        at = int(np.argmax(wrong)) + 1
        last, here = stamps[at - 1], stamps[at]
        if here == last:
            raise lines[at].refused(f"stamp {here:.9f} is that of the line above", "keep one line for each stamp")
        raise lines[at].refused(f"stamp {here:.9f} comes after {last:.9f}", "sort the lines by time")


def require_ranges(lines: Sequence[Line], ranges: Float) -> None:
    """Refuse the first line whose range [m] is negative."""
    negative = ranges < 0.0
    if negative.any():
        raise lines[int(np.argmax(negative))].refused("the range is negative", "remove the line")


def require_bearings(lines: Sequence[Line], bearings: Float) -> None:
    """Refuse the first line whose bearing [rad] is larger than a full turn: it may be in degrees."""
    wrong = np.abs(bearings) > 2.0 * np.pi
    if wrong.any():
        at = int(np.argmax(wrong))
        remedy = "correct the unit (in csv: bearing [deg] in the header, or observations.angle), or wrap it"
        raise lines[at].refused(f"the bearing {bearings[at]:.6g} rad is more than a full turn", remedy)
