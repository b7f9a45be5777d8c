"""Lines of people's text files, each with its place, so that whatever is wrong is told by file and line.

Files are UTF-8 with any line ends; what follows a # and empty lines are left out.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import explained
from slamgauge.errors import UserError
from slamgauge.validation import LARGEST

LARGEST_ID = 2**53  # beyond it not every whole number is a float64
REMARKS = ("#", "%")  # what lines of tables begin with that are remarks, or names of columns
PATIENCE = 2.0  # seconds of reading before a terminal shows progress


@dataclass(frozen=True, slots=True)
class Line:
    """One line: its file, its number from 1, and its words."""

    path: Path
    number: int
    words: list[str]

    @property
    def where(self) -> str:
        """Its place, as error texts begin."""
        return f"{self.path}, line {self.number}"

    def refused(self, what: str, remedy: str) -> UserError:
        """The error that tells what is wrong with the line."""
        return UserError(f"{self.where}: {what}; {remedy}")

    def require(self, form: str) -> None:
        """Refuse the line unless it has as many words as its form, `TAG i j x y` for instance."""
        if len(self.words) != len(form.split()):
            raise self.refused(f"has {len(self.words)} words, not {len(form.split())}", f"write {form}")

    def numbers(self, first: int, last: int | None = None) -> list[float]:
        """The words from `first` up to `last` as numbers of a believable size."""
        return [self.number_at(at) for at in range(first, len(self.words) if last is None else last)]

    def number_at(self, at: int) -> float:
        """The word at a place as a number of a believable size."""
        try:
            number = float(self.words[at])
        except ValueError:
            number = math.nan
        if not abs(number) < LARGEST:
            raise self.refused(f"{self.words[at][:40]!r} is no finite number", "correct it, or remove the line")
        return number

    def id_at(self, at: int, least: int = 0) -> int:
        """The word at a place as a whole number, `least` or more; 3.0 is one, too."""
        number = self.number_at(at)
        if not number.is_integer() or not least <= number < LARGEST_ID:
            raise self.refused(f"{self.words[at][:40]!r} is no id", f"give a whole number from {least} below 2**53")
        return int(number)


def read_lines(path: Path, *, comment: str = "#", separators: str = "") -> Iterator[Line]:
    """The lines of a text file that say something; a terminal shows progress if this takes long.

    Args:
        path: The file.
        comment: What begins a remark, up to the end of its line; none if empty.
        separators: Characters that may stand between words: the first of them that the first line without a # or a % in
            front has does, and white space where it has none.

    Raises:
        UserError: the file cannot be read, or is no text.
    """
    text = io.StringIO(read_text(path), newline=None)
    first = next((line for line in text if line.strip() and line.lstrip()[0] not in REMARKS), "")
    separator = next((each for each in separators if each in first), None)
    text.seek(0)
    shown = tqdm(text, desc=path.name, delay=PATIENCE, disable=None, leave=False, unit="line")
    for number, line in enumerate(shown, start=1):
        said = line.partition(comment)[0] if comment else line
        if said.strip():
            yield Line(path, number, [word.strip() for word in said.split(separator)])


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    Raises:
        UserError: the file cannot be read, or the line at which it is no text.
    """
    with explained(path, "read"):
        content = path.read_bytes()
    broken = content.find(b"\0")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        text, broken = "", error.start
    if broken >= 0:
        line = content.count(b"\n", 0, broken) + 1
        raise UserError(f"{path}, line {line}: not a text in UTF-8; give another file, or save it as such")
    return text


def read_table(path: Path, form: str) -> tuple[list[Line], Float]:
    """The lines of a file of numbers alone, and the numbers (n, k) of its k columns.

    Args:
        path: The file.
        form: Names of the columns, `time x y` for instance.

    Raises:
        UserError: the file cannot be read, a line has not the form, or there is none.
    """
    lines, rows = list(read_lines(path)), list[list[float]]()
    for line in lines:
        line.require(form)
        rows.append(line.numbers(0))
    if not rows:
        raise UserError(f"{path}: no line in it; write lines of {form}")
    return lines, np.array(rows)


def require_order(lines: Sequence[Line], stamps: Float, *, strict: bool) -> None:
    """Refuse the first line whose stamp [s] is before that of the line above, or not after it if `strict`."""
    ahead = np.diff(stamps)
    wrong = ahead <= 0.0 if strict else ahead < 0.0
    if wrong.any():
        at = int(np.argmax(wrong)) + 1
        last, here = stamps[at - 1], stamps[at]
        raise lines[at].refused(f"stamp {here:.9f} comes after {last:.9f}", "sort the lines by time")


def require_ranges(lines: Sequence[Line], ranges: Float) -> None:
    """Refuse the first line whose range [m] is below 0."""
    negative = ranges < 0.0
    if negative.any():
        raise lines[int(np.argmax(negative))].refused("the range is negative", "remove the line")
