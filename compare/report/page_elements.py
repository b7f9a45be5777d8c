"""Contents of pages: sections with sentences, tables and pictures; styles of estimators; provenance."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from slamgauge.compare.figures.plot_style import LineStyle, styles
from slamgauge.compare.scoring.table import Table
from slamgauge.version import __version__

LONGEST_DASH = 12.0  # line widths


class Line(NamedTuple):
    """Sentence of a list, with the name of what it is about."""

    name: str
    text: str
    link: str = ""


class Picture(NamedTuple):
    """Picture inside the page, with alternative text."""

    source: str
    alt: str
    caption: str


class Look(NamedTuple):
    """Style of an estimator, and whether it is visible when the page opens."""

    name: str
    color: str
    dashes: tuple[float, ...]
    shown: bool = True


@dataclass(frozen=True)
class Section:
    """Part of a page under a heading; its parts are shown in the order of the fields."""

    title: str
    id: str = ""  # name for links
    texts: Sequence[str] = ()  # paragraphs
    lines: Sequence[Line] = ()
    tables: Sequence[Table] = ()  # tables without rows are not shown
    pictures: Sequence[Picture] = ()
    verbatim: str = ""  # text that a program printed
    link: str = ""  # address of a replay, shown after the last paragraph
    level: int = 2  # level of the heading
    is_folded: bool = False  # a click opens the section
    include: str = ""  # template of an interactive part

    def __bool__(self) -> bool:
        """Whether the section has any content."""
        tables = any(table.rows for table in self.tables)
        return bool(self.texts or self.lines or tables or self.pictures or self.verbatim or self.include)


@dataclass(frozen=True)
class Page:
    """What a page shows."""

    kind: str  # kind of the results, shown above the title
    title: str
    lead: Sequence[Line]  # first sentences, each with the name of its estimator
    origin: Sequence[tuple[str, str, bool]]  # provenance, see `origin`
    notes: Sequence[Line] = ()
    picture: Picture | None = None  # next to the first sentences
    sections: Sequence[Section] = ()  # empty ones are not shown
    looks: Sequence[Look] = ()
    terms: Sequence[tuple[str, str]] = ()  # terms of the glossary, besides the columns of the tables
    back: str = ""  # link to the page above
    legend: str = ""  # explanation of the replay
    data: dict[str, Any] = field(default_factory=dict)  # JSON for the scripts


def said(texts: Iterable[str]) -> list[Line]:
    """Return sentences that are about no estimator."""
    return [Line("", text) for text in texts]


def looks(names: Iterable[str], hidden: Iterable[str] = ()) -> list[Look]:
    """Return the colours and dashes of the figures for these estimators."""
    off = set(hidden)
    return [Look(name, style.color, _dashes(style.dashes), name not in off) for name, style in styles(names).items()]


def _dashes(dashes: LineStyle) -> tuple[float, ...]:
    return () if isinstance(dashes, str) else tuple(min(float(each), LONGEST_DASH) for each in dashes[1])


def pictures(folder: Path, known: Mapping[str, tuple[str, str]]) -> list[Picture]:
    """Return the figures in a folder; `known` has alternative text and caption by file name."""
    found = [((folder / name).read_bytes(), *texts) for name, texts in known.items() if (folder / name).is_file()]
    return [Picture(f"data:image/png;base64,{base64.b64encode(png).decode()}", *texts) for png, *texts in found]


def origin(content: Mapping[str, Any], more: Iterable[tuple[str, str]] = ()) -> list[tuple[str, str, bool]]:
    """Return the provenance of results with the JSON `content`: rows of term, text, is_code. They contain no date."""
    rows = [
        ("Command", content.get("command") or None, True),
        ("Scenario", content.get("scenario"), False),
        ("Seed", content.get("seed"), False),
        *((term, text, False) for term, text in more),
        ("Digest of the measurements", content.get("digest"), True),
        ("slamgauge", content.get("version") or __version__, False),
    ]
    return [(term, str(text), is_code) for term, text, is_code in rows if text is not None]
