"""Elements of pages: pictures, styles of estimators, provenance."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from slamgauge.compare.figures.plot_style import LineStyle, styles
from slamgauge.version import __version__

LONGEST_DASH = 12.0  # line widths


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
