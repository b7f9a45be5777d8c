"""Standard streams, and the width of the tables on them."""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from slamgauge.compare.scoring.table import Page

PIPED = 80  # characters: the width in pipes, and the smallest width on terminals


@dataclass(frozen=True)
class Output:
    """How results are printed.

    Attributes:
        json: Print JSON (docs/glossary.md) on standard output instead of the table.
        wide: Print all columns, and do not wrap lines. By default a table fits the terminal; in pipes, 80 characters.
    """

    json: bool = False
    wide: bool = False

    def show(self, content: object, page: Page, file: Path | None = None) -> None:
        """Print `content` as JSON, or the page; write the JSON to a file, if one is given."""
        text = json.dumps(content, indent=2, allow_nan=False)
        width = max(PIPED, shutil.get_terminal_size().columns) if sys.stdout.isatty() else PIPED
        put(text if self.json else page.text(None if self.wide else width))
        if file is not None:
            file.write_text(f"{text}\n", encoding="utf-8")


def put(text: str) -> None:
    """Print a text. A reader that closes its pipe early, as `head` does, loses the rest of it alone."""
    try:
        print(text)
        sys.stdout.flush()
    except BrokenPipeError:
        drop_output()


def drop_output() -> None:
    """Redirect standard output, with what is in its buffer, to the null device."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def prepare_streams() -> None:
    """Escape characters that the encoding of a stream lacks."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
