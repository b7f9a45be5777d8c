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
SEPARATORS = ";\t"  # separators of CSV files, if the header has one of them; else a comma
NOTHING: Mapping[str, str] = {}


@dataclass(frozen=True, slots=True)
class Line:
    """A line: its file, its number from 1, and its words."""

    path: Path | str
    number: int
    words: list[str]

    def refused(self, what: str, remedy: str) -> UserError:
        """Return the error for a mistake in the line."""
        return UserError(f"{self.path}, line {self.number}: {what}; {remedy}")

    def require(self, form: str) -> None:
        """Refuse the line unless it has as many words as its form, for example `TAG i j x y`."""
        if len(self.words) != len(form.split()):
            raise self.refused(f"has {len(self.words)} words, not {len(form.split())}", f"write {form}")

    def numbers(self, first: int = 0) -> list[float]:
        """Return the words from place `first` on as numbers, see `number_at`."""
        return [self.number_at(at) for at in range(first, len(self.words))]

    def number_at(self, at: int) -> float:
        """Return the word at a place as a number; refuse it if it is not finite or larger than `LARGEST`."""
        number = number_of(self.words[at])
        if not abs(number) < LARGEST:
            raise self.wrong_word(at, "is not a finite number", "correct it, or remove the line")
        return number

    def id_at(self, at: int, least: int = 0) -> int:
        """Return the word at a place as a whole number, `least` or more; 3.0 is one, too."""
        number = number_of(self.words[at])
        if not number.is_integer() or not least <= number < LARGEST_ID:
            raise self.wrong_word(at, "is not an id", f"give a whole number from {least} below 2**53")
        return int(number)

    def wrong_word(self, at: int, what: str, remedy: str) -> UserError:
        """Return the error for a mistake in the word at a place."""
        return UserError(f"{self.path}, line {self.number}, column {at + 1}: {self.words[at][:40]!r} {what}; {remedy}")


def number_of(word: str) -> float:
    """Return a word as a number, NaN if it is not a number; 1_0 may be a name, and is not 10."""
    try:
        return math.nan if "_" in word else float(word)
    except ValueError:
        return math.nan


def read_whole(path: Path) -> str:
    """Return the text of a file; print a notice if it has no line end: a number that is cut short is still a number.

    Raises:
        UserError: the file cannot be read, or is not a text.
    """
    text = read_text(path)
    if text.strip() and not text.endswith(("\n", "\r")):
        last = text.splitlines()[-1][-40:]
        tell_once(f"{path}: no line end after {last!r}: the file may be cut; check this number and add a line end")
    return text


def read_lines(path: Path, separator: str = " ") -> list[Line]:
    """Return the lines of a text file, words between white space or a separator; text behind a # is a remark."""
    lines = enumerate(io.StringIO(read_whole(path).replace(separator, " "), newline=None), start=1)
    words = ((number, line.partition("#")[0].split()) for number, line in lines)
    return [Line(path, number, each) for number, each in words if each]


def csv_lines(path: Path | str, text: str) -> list[Line]:
    """Return the lines of a CSV text, words between commas, or semicolons or tabs; the file's name is for messages.

    Lines that begin with # or % are remarks. The last of them above the first row names the columns if no other line
    does, as in files of `numpy.savetxt`.
    """
    lines = [(number, line) for number, line in enumerate(io.StringIO(text, newline=None), start=1) if line.strip()]
    first = next((at for at, (_, line) in enumerate(lines) if line.lstrip()[0] not in "#%"), None)
    if first is None:
        return []
    separator = next((each for each in SEPARATORS if each in lines[first][1]), ",")
    rows = [Line(path, n, _cells(line, separator)) for n, line in lines[first:] if line.lstrip()[0] not in "#%"]
    if first > 0 and not math.isnan(number_of(rows[0].words[-1])):
        number, line = lines[first - 1]
        rows.insert(0, Line(path, number, _cells(line.lstrip()[1:], separator)))
    return rows


def _cells(line: str, separator: str) -> list[str]:
    """Return the cells of a line without spaces around them; `csv` reads those in quotes."""
    is_plain = '"' not in line  # twice as fast
    cells = line.split(separator) if is_plain else next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip() for cell in cells]


def rows_below(path: Path | str, text: str, *headers: tuple[str, ...], words: Mapping[str, str] = NOTHING) -> Float:
    """Return the numbers (n, columns) of a CSV text with one of the given headers.

    Args:
        path: The file, for messages.
        text: Its text.
        headers: Allowed headers; each begins with the columns of the first.
        words: Names of columns by other words for them that the header may have.

    Raises:
        UserError: the header is another one, or a line has another number of values or one that is not finite.
    """
    lines = csv_lines(path, text)
    if header_of(lines, words) not in headers:
        more = [",".join(each[len(headers[0]) :]) for each in headers[1:]]
        remedy = f"write {','.join(headers[0])}" + "".join(f", with or without {each}" for each in more if each)
        raise UserError(f"{path}: line 1 is not the header of this file; {remedy}")
    require_width(lines)
    return np.array([line.numbers() for line in lines[1:]], dtype=np.float64).reshape(-1, len(lines[0].words))


def header_of(lines: Sequence[Line], words: Mapping[str, str] = NOTHING) -> tuple[str, ...]:
    """Return the names in the first line, those in `words` replaced; none without a line."""
    return tuple(words.get(word, word) for line in lines[:1] for word in line.words)


def require_width(lines: Sequence[Line]) -> None:
    """Refuse the first line that does not have as many words as the first, the header."""
    for line in lines:
        if len(line.words) != len(lines[0].words):
            what = f"has {len(line.words)} columns where the header has {len(lines[0].words)}"
            raise line.refused(what, "correct the line")


def read_table(path: Path, form: str) -> tuple[list[Line], Float]:
    """Read a file of numbers only; return its lines and the numbers (n, k) of its k columns.

    Args:
        path: The file.
        form: Names of the columns, for example `time x y`.

    Raises:
        UserError: the file cannot be read or has no lines, or a line does not have the form.
    """
    lines = read_lines(path)
    for line in lines:
        line.require(form)
    if not lines:
        raise UserError(f"{path}: no line in it; write lines of {form}")
    return lines, np.array([line.numbers() for line in lines])


def read_tagged(
    path: Path, forms: Mapping[str, str], unsupported: Mapping[str, str] = NOTHING
) -> dict[str, list[Line]]:
    """Read the lines of a file by their first word, the tag.

    Args:
        path: The file.
        forms: Form of the lines of each tag, for example `SENSOR id range bearing`; "" allows any number of words.
        unsupported: Parts of further tags, and what their lines are; they are refused.

    Raises:
        UserError: the file cannot be read, a tag is unknown, or a line does not have the form of its tag.
    """
    lines: dict[str, list[Line]] = {tag: [] for tag in forms}
    for line in read_lines(path):
        tag = line.words[0]
        if tag not in forms:
            for part, what in unsupported.items():
                if part in tag:
                    raise line.refused(f"{tag[:30]} is {what}, which is not supported", "leave such lines out")
            raise line.refused(f"{tag[:30]!r} is an unknown tag", did_you_mean(tag[:30], forms))
        if forms[tag]:
            line.require(forms[tag])
        lines[tag].append(line)
    return lines
