"""Lines of users' text files with their places, so that each error names file, line and column.

Files are UTF-8, with any line ends. Empty lines are ignored.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.storage.files import read_text
from slamgauge.errors import UserError
from slamgauge.notices import tell_once
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

LARGEST_ID = 2**53  # not every larger whole number is a float64
REMARKS = ("#", "%")  # begins of lines of CSV files that are no rows
SEPARATORS = ";\t"  # separators of CSV files, if the header has one of them; else a comma
Form = Sequence[str]  # names of the words of a line


@dataclass(frozen=True, slots=True)
class Line:
    """A line: its file, its number from 1, and its words."""

    path: Path | str
    number: int
    words: list[str]

    def refused(self, what: str, remedy: str, at: int | None = None) -> UserError:
        """Return the error for a mistake in the line, or in the word at a place."""
        place, word = ("", "") if at is None else (f", column {at + 1}", f"{self.words[at][:40]!r} ")
        return UserError(f"{self.path}, line {self.number}{place}: {word}{what}; {remedy}")

    def require(self, form: Form) -> None:
        """Refuse the line unless it has as many words as its form."""
        if len(self.words) != len(form):
            raise self.refused(f"has {len(self.words)} words, not {len(form)}", f"write {' '.join(form)}")

    def numbers(self, first: int = 0) -> list[float]:
        """Return the words from place `first` on as numbers, see `number_at`."""
        return [self.number_at(at) for at in range(first, len(self.words))]

    def number_at(self, at: int) -> float:
        """Return the word at a place as a number; refuse it if it is not finite or larger than `LARGEST`."""
        number = number_of(self.words[at])
        if not abs(number) < LARGEST:
            raise self.refused("is not a finite number", "correct it, or remove the line", at)
        return number

    def id_at(self, at: int, least: int = 0) -> int:
        """Return the word at a place as a whole number, `least` or more; 3.0 is one, too."""
        number = number_of(self.words[at])
        if not number.is_integer() or not least <= number < LARGEST_ID:
            raise self.refused("is not an id", f"give a whole number from {least} below 2**53", at)
        return int(number)


def number_of(word: str) -> float:
    """Return a word as a number, NaN if it is not a number; 1_0 may be a name, and is not 10."""
    try:
        return math.nan if "_" in word else float(word)
    except ValueError:
        return math.nan


def read_whole(path: Path) -> str:
    """Return the text of a file; print a notice if it has no line end: a number that is cut short is still a number."""
    text = read_text(path)
    if text.strip() and not text.endswith(("\n", "\r")):
        last = text.splitlines()[-1][-40:]
        tell_once(f"{path}: no line end after {last!r}: the file may be cut; check this number and add a line end")
    return text


# --- CSV ------------------------------------------------------------------------------------------


def csv_lines(path: Path | str, text: str) -> list[Line]:
    """Return the lines of a CSV text, words between commas, or semicolons or tabs; the file's name is for messages.

    Lines that begin with # or % are remarks. The last of them above the first row names the columns if no other line
    does, as in files of `numpy.savetxt`.
    """
    numbered = enumerate(io.StringIO(text, newline=None), start=1)
    lines = [(number, line) for number, line in numbered if line.strip()]
    rows = [(number, line) for number, line in lines if not line.lstrip().startswith(REMARKS)]
    if not rows:
        return []
    separator = next((each for each in SEPARATORS if each in rows[0][1]), ",")
    found = [Line(path, number, _cells(line, separator)) for number, line in rows]
    above = lines[: lines.index(rows[0])]
    if above and not math.isnan(number_of(found[0].words[-1])):
        number, remark = above[-1]
        found.insert(0, Line(path, number, _cells(remark.lstrip()[1:], separator)))
    return found


def _cells(line: str, separator: str) -> list[str]:
    """Return the cells of a line without spaces around them; `csv` reads those in quotes."""
    is_plain = '"' not in line  # twice as fast
    cells = line.split(separator) if is_plain else next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip() for cell in cells]


def rows_below(path: Path | str, text: str, *headers: Form) -> Float:
    """Return the numbers (n, columns) of a CSV text; refuse another header than these."""
    lines = csv_lines(path, text)
    if not lines or (*lines[0].words,) not in headers:
        known = " or ".join(",".join(header) for header in headers)
        raise UserError(f"{path}: line 1 is not the header of this file; write {known}")
    return _numbers(lines[1:], lines[0].words)


def _numbers(lines: Sequence[Line], form: Form) -> Float:
    for line in lines:
        line.require(form)
    return np.array([line.numbers() for line in lines], dtype=np.float64).reshape(-1, len(form))


# --- words between white space --------------------------------------------------------------------


def _read_lines(path: Path) -> list[Line]:
    """Return the lines of a text file, words between white space or commas; text behind a # is a remark."""
    lines = enumerate(io.StringIO(read_whole(path).replace(",", " "), newline=None), start=1)
    words = ((number, line.partition("#")[0].split()) for number, line in lines)
    return [Line(path, number, each) for number, each in words if each]


def read_table(path: Path, form: str, more: Form = ()) -> tuple[list[Line], Float]:
    """Read a file of numbers only; return its lines and the numbers (n, columns).

    `form` has the names of the columns, for example `time x y`. The columns `more` may follow, in all lines or in none.
    """
    lines, columns = _read_lines(path), form.split()
    if not lines:
        raise UserError(f"{path}: no line in it; write lines of {form}")
    return lines, _numbers(lines, [*columns, *more] if len(lines[0].words) > len(columns) else columns)


def read_tagged(path: Path, forms: Mapping[str, str], unsupported: Mapping[str, str]) -> dict[str, list[Line]]:
    """Read the lines of a file by their first word, the tag.

    `forms` are those of the lines of each tag, for example `SENSOR id range bearing`; "" allows any number of words.
    `unsupported` has parts of further tags, and what their lines are; these are refused.
    """
    lines: dict[str, list[Line]] = {tag: [] for tag in forms}
    for line in _read_lines(path):
        tag = line.words[0]
        if tag not in forms:
            for part, what in unsupported.items():
                if part in tag:
                    raise line.refused(f"{tag[:30]} is {what}, which is not supported", "leave such lines out")
            raise line.refused(f"{tag[:30]!r} is an unknown tag", did_you_mean(tag[:30], forms))
        if forms[tag]:
            line.require(forms[tag].split())
        lines[tag].append(line)
    return lines
