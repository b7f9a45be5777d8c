"""How tables are printed: as wide as there is room, in sparing colours where somebody looks."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from slamgauge.compare.scoring.text_page import Page, Tone

PIPED = 80  # characters, where no terminal says how many it has; no terminal is taken for narrower
SIGNS = {"plain": "", "head": "\x1b[1m", "good": "\x1b[32m", "bad": "\x1b[31m", "faint": "\x1b[2m"}
END = "\x1b[0m"


@dataclass(frozen=True)
class Output:
    """How results are printed."""

    json: bool = False
    """Print JSON (docs/json.md) on standard output instead of the table."""

    wide: bool = False
    """Print all columns, and every line whole. Otherwise tables are as wide as the terminal, 80 characters at least
    and in pipes."""

    color: Literal["auto", "always", "never"] = "auto"
    """Colours: on a terminal where NO_COLOR is not set, always, or never."""


_OUTPUT: ContextVar[Output] = ContextVar("_OUTPUT")


@contextmanager
def printed_as(output: Output) -> Generator[None]:
    """Within the block pages are laid out like this."""
    token = _OUTPUT.set(output)
    try:
        yield
    finally:
        _OUTPUT.reset(token)


def laid_out(page: Page) -> str:
    """The page as it is to be printed on standard output."""
    from slamgauge.compare.scoring.text_page import plain

    output = _OUTPUT.get(Output())
    return page.text(None if output.wide else _width(), _painted if _has_colours(output) else plain)


def _width() -> int:
    return max(PIPED, shutil.get_terminal_size().columns) if sys.stdout.isatty() else PIPED


def _has_colours(output: Output) -> bool:
    if output.color != "auto":
        return output.color == "always"
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _painted(text: str, tone: Tone) -> str:
    return f"{SIGNS[tone]}{text}{END}" if SIGNS[tone] else text
