"""Standard streams, and the width and colours of the tables on them."""

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
    from slamgauge.compare.scoring.text_page import Page, Tone

PIPED = 80  # characters: the width in pipes, and the smallest width on terminals
SIGNS = {"plain": "", "head": "\x1b[1m", "good": "\x1b[32m", "bad": "\x1b[31m", "faint": "\x1b[2m"}
END = "\x1b[0m"


@dataclass(frozen=True)
class Output:
    """How results are printed.

    Attributes:
        json: Print JSON (docs/glossary.md) on standard output instead of the table.
        wide: Print all columns, and do not wrap lines. By default a table fits the terminal, or 80 characters in a
            pipe.
    """

    json: bool = False
    wide: bool = False

    def show(self, content: object, page: Page, file: Path | None = None) -> None:
        """Print `content` as JSON, or the page; write the JSON to a file, if one is given."""
        text = json.dumps(content, indent=2, allow_nan=False)
        put(text if self.json else self.laid_out(page))
        if file is not None:
            file.write_text(f"{text}\n", encoding="utf-8")

    def laid_out(self, page: Page) -> str:
        """Return the text of a page for this terminal or pipe, with colours on terminals if NO_COLOR is not set."""
        is_terminal = sys.stdout.isatty()
        width = max(PIPED, shutil.get_terminal_size().columns) if is_terminal else PIPED
        width = None if self.wide else width
        is_plain = not is_terminal or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        return page.text(width) if is_plain else page.text(width, _painted)


def _painted(text: str, tone: Tone) -> str:
    return f"{SIGNS[tone]}{text}{END}" if SIGNS[tone] else text


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
