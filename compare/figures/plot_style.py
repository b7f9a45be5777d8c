"""Style of figures: colours for colour-blind readers, line styles for grey print, width and file formats."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import cycle
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from slamgauge import errors
from slamgauge.compare.estimators.registry import BOUNDS, REGISTRY
from slamgauge.compare.estimators.registry import DEAD_RECKONING as DEAD_RECKONING
from slamgauge.compare.figures.svg_size import small_svg

Format = Literal["pdf", "png", "svg"]
Width = Literal["column", "page"]
INCHES: dict[Width, float] = {"column": 3.4, "page": 7.0}  # widths in a paper with two columns
ENTRY = 1.1  # [in] width of a legend entry
LineStyle = str | tuple[int, tuple[float, ...]]

TRUTH_COLOR = "#000000"
MARK_COLOR = "#777777"  # loop closures and other marks
MOST_AT_ONCE = 20_000  # points of a line that are drawn together; a path of a thousand loops needs 100 MB in one piece
STYLE = Path(errors.__file__).with_name("paper.mplstyle")  # users load it by the name slamgauge.paper
PRINT: dict[Any, Any] = {
    **mpl.rc_params_from_file(STYLE, use_default_template=False),
    "figure.constrained_layout.use": False,  # figures that need it set it themselves
    "text.parse_math": False,  # user-given names may contain dollars; numbers on axes are plain (`logarithmic`)
    "svg.hashsalt": "slamgauge",  # files are reproducible
    "agg.path.chunksize": MOST_AT_ONCE,
}
WRAPPED: dict[str, Any] = {"wrap": True, "parse_math": True}  # wrapped texts may contain formulas: see `math_text`
LEGEND: dict[str, Any] = {"frameon": False, "handlelength": 2.6, "handletextpad": 0.6, "columnspacing": 1.2}


class Style(NamedTuple):
    """Colour and dashes of one estimate, for paths and error curves."""

    color: str
    dashes: LineStyle


# styles of built-in estimators; user estimators take those of `USER_STYLES`
KNOWN = {name: Style(*entry.look) for name, entry in (REGISTRY | BOUNDS).items() if entry.look is not None}
USER_STYLES = (
    Style("#332288", (0, (4, 2))),
    Style("#999933", (0, (6, 1, 2, 1))),
    Style("#EE7733", (0, (1.5, 0.8))),
    Style("#AA3377", (0, (3, 2, 1, 2))),
    Style("#44AA99", (0, (8, 1, 1, 1))),
    Style("#555555", (0, (2, 2))),
)


def styles(names: Iterable[str]) -> dict[str, Style]:
    """Return a style for each name; names without one in the registry take `USER_STYLES` in turn."""
    users = cycle(USER_STYLES)
    return {name: KNOWN.get(name) or next(users) for name in names}


class Sheet(NamedTuple):
    """Largest width and file formats of figures."""

    width: Width = "page"
    formats: Sequence[Format] = ("png", "svg")

    @property
    def inches(self) -> float:
        """The width [in]."""
        return INCHES[self.width]

    @property
    def is_narrow(self) -> bool:
        """Whether the figure has one column of panels."""
        return self.width == "column"

    def legend_columns(self, entries: int) -> int:
        """Return the number of legend columns for rows of about equal length."""
        rows = -(-entries // max(int(self.inches / ENTRY), 1))
        return -(-entries // max(rows, 1)) or 1


USUAL = Sheet()
_SHEET: ContextVar[Sheet] = ContextVar("_SHEET", default=USUAL)


def sheet() -> Sheet:
    """Return the current sheet."""
    return _SHEET.get()


@contextmanager
def printed_on(chosen: Sheet) -> Generator[None]:
    """Use the sheet for all figures of the block."""
    token = _SHEET.set(chosen)
    try:
        yield
    finally:
        _SHEET.reset(token)


@contextmanager
def printed(path: Path, height: float, title: str = "") -> Generator[Figure]:
    """Yield a new figure of a height [in] in the print style, and write it at the end (see `save_printed`)."""
    with mpl.rc_context(PRINT):
        figure = Figure(figsize=(sheet().inches, height), layout="constrained")
        if title:
            figure.suptitle(math_text(title), **WRAPPED)
        yield figure
        save_printed(figure, path)


def math_text(text: str) -> str:
    r"""Escape dollar signs, for texts in which matplotlib parses formulas: the wrapped ones."""
    return text.replace("$", r"\$")


def save_printed(figure: Figure, path: Path) -> None:
    """Write the figure in the formats of the sheet (png at 200 dpi); files contain no date."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)  # it places the parts, once for all formats
        figure.set_layout_engine(None)  # with "none" each format would be drawn twice
    for each in sheet().formats:
        if each == "svg":
            path.with_suffix(".svg").write_bytes(small_svg(figure))
        else:
            undated = {"CreationDate": None} if each == "pdf" else {}
            figure.savefig(path.with_suffix(f".{each}"), dpi=200, metadata=undated)


def legend_below(figure: Figure, axes: Axes) -> None:
    """Draw the legend of the axes below all axes of the figure."""
    handles, labels = axes.get_legend_handles_labels()
    columns = sheet().legend_columns(len(labels))
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, **LEGEND)
