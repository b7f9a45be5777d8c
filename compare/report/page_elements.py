"""What pages are made of: tables, pictures, looks of estimators, where results come from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from slamgauge.compare.figures.plot_style import LineStyle, styles
from slamgauge.compare.report.page import data_source
from slamgauge.version import __version__

LONGEST_DASH = 12.0  # line widths


class Head(NamedTuple):
    """A column: its title, what it means, and whether it holds words."""

    title: str
    help: str = ""
    words: bool = False


class Cell(NamedTuple):
    """What is read, the figure that it sorts by, and where it leads."""

    text: str
    value: float | None = None
    link: str = ""


@dataclass(frozen=True)
class Table:
    """A table that sorts; the first cell of a row names it."""

    id: str
    caption: str
    columns: Sequence[Head]
    rows: Sequence[Sequence[Cell]]


class Picture(NamedTuple):
    """A picture within the page, and what it shows, for those who do not see it."""

    source: str
    alt: str
    caption: str


class Look(NamedTuple):
    """How an estimator is drawn, and whether it is at first."""

    name: str
    color: str
    dashes: tuple[float, ...]
    shown: bool = True


def looks(names: Iterable[str], hidden: Iterable[str] = ()) -> list[Look]:
    """Colours and dashes as in the figures."""
    away = set(hidden)
    return [Look(name, style.color, _dashes(style.dashes), name not in away) for name, style in styles(names).items()]


def _dashes(dashes: LineStyle) -> tuple[float, ...]:
    return () if isinstance(dashes, str) else tuple(min(float(each), LONGEST_DASH) for each in dashes[1])


def pictures(folder: Path, known: Mapping[str, tuple[str, str]]) -> list[Picture]:
    """Those of the `known` figures, by file name, that lie in a folder: each with its alternative text and caption."""
    found = [(folder / name, *texts) for name, texts in known.items() if (folder / name).is_file()]
    return [Picture(data_source(path.read_bytes(), "image/png"), alt, caption) for path, alt, caption in found]


def origin(path: Path, content: Mapping[str, Any], more: Iterable[tuple[str, str]] = ()) -> list[tuple[str, str, bool]]:
    """Where results come from, as `path`, whose JSON is `content`, tells: term, text, whether it is code."""
    written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    rows = [
        ("Command", content.get("command") or None, True),
        ("Scenario", content.get("scenario"), False),
        ("Seed", content.get("seed"), False),
        *((term, text, False) for term, text in more),
        ("Digest of the measurements", content.get("digest"), True),
        ("slamgauge", content.get("version") or __version__, False),
        ("Written", f"{written:%Y-%m-%d %H:%M} UTC", False),
    ]
    return [(term, str(text), is_code) for term, text, is_code in rows if text is not None]


def sized(value: object) -> float | None:
    """A figure to sort by, None where there is none."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
