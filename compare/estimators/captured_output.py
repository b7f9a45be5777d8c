"""What user code prints is kept in a file, so that it hides no results and no messages.

Every process has one file for each estimator that prints, in the system's temporary folder, of at most `LARGEST` bytes.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import IO

from slamgauge.compare.storage.safe_names import file_name, shown
from slamgauge.notices import tell_once

LARGEST = 10_000_000  # bytes
FIRST = 3  # lines that error messages contain
WIDEST = 120  # characters of such a line

_files: dict[str, IO[str]] = {}  # estimator -> file of this process


class Captured(io.TextIOBase):
    """A text stream that writes to the file of an estimator."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._beginning = ""

    def write(self, text: str, /) -> int:
        """Append a text to the file, as far as this may grow."""
        if len(self._beginning) < FIRST * WIDEST:
            self._beginning += text[: FIRST * WIDEST]
        file = _file_of(self._name)
        if file is not None and file.tell() < LARGEST:
            file.write(text)
            file.flush()
        return len(text)

    @property
    def first_lines(self) -> str:
        """The first lines, in one line; empty if nothing was printed."""
        lines = [shown(line.strip()[:WIDEST]) for line in self._beginning.splitlines() if line.strip()]
        return " / ".join(lines[:FIRST])

    @property
    def place(self) -> Path | None:
        """The file; None if nothing was printed, or no file could be made."""
        file = _files.get(self._name)
        return None if file is None else Path(file.name)


@contextmanager
def captured(name: str) -> Generator[Captured]:
    """Keep away what is printed inside, and tell once in which file it is."""
    output = Captured(name)
    with redirect_stdout(output), redirect_stderr(output):
        yield output
    if output.first_lines and output.place is not None:
        tell_once(f"{name}: what it prints is kept in {output.place}")


def _file_of(name: str) -> IO[str] | None:
    if name not in _files:
        try:
            beginning = f"slamgauge-printed-{file_name(name)[:40]}-"
            _files[name] = tempfile.NamedTemporaryFile(  # noqa: SIM115 open until the process ends
                "w", prefix=beginning, suffix=".txt", delete=False, encoding="utf-8", errors="replace"
            )
        except OSError:  # no room: it is dropped
            return None
    return _files[name]
