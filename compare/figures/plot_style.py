"""What all figures share: styles of estimators, width, formats, title and legend.

Colours are for colour-blind readers, line styles for grey print.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import cycle
from pathlib import Path
from typing import Any, Literal, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure, FigureBase

from slamgauge import errors
from slamgauge.compare.estimators.registry import BOUND, DEAD_RECKONING, HINDSIGHT_BOUND

Format = Literal["pdf", "png", "svg"]
Width = Literal["column", "page"]
INCHES: dict[Width, float] = {"column": 3.4, "page": 7.0}  # widths in a paper with two columns
ENTRY = 1.1  # [in] width of a legend entry
CHARACTERS = 13  # characters of a title, per inch
LineStyle = str | tuple[int, tuple[float, ...]]

TRUTH_COLOR = "#000000"
MARK_COLOR = "#777777"  # loop closures and other marks
STYLE = Path(errors.__file__).with_name("paper.mplstyle")  # users load it by the name slamgauge.paper
PRINT: dict[Any, Any] = {
    **mpl.rc_params_from_file(STYLE, use_default_template=False),
    "figure.constrained_layout.use": False,  # else `save_printed` would compute the layout again for each format
    "text.parse_math": False,  # user-given names may contain dollars; numbers on axes are plain (`logarithmic`)
    "svg.hashsalt": "slamgauge",  # files are reproducible
    "agg.path.chunksize": 20_000,  # a path of a thousand loops needs 100 MB in one piece
}
UNDATED: dict[Format, dict[str, None]] = {"pdf": {"CreationDate": None}, "png": {}, "svg": {"Date": None}}


class Style(NamedTuple):
    """Colour and dashes of one estimate, for paths and error curves."""

    color: str
    dashes: LineStyle


# styles of built-in estimators, others take those of `USER_STYLES`: P. Tol, "Colour schemes" (SRON/EPS/TN/09-002)
STYLES = {
    DEAD_RECKONING: Style("#009988", (0, (1, 1.4))),
    "textbook-ekf": Style("#6A5ACD", (0, (7, 3))),
    "ekf": Style("#CC3311", (0, (5, 1.2))),
    "fej-ekf": Style("#33BBEE", (0, (3, 1, 1, 1, 1, 1))),
    "oc-ekf": Style("#EE3377", (0, (6, 1, 1, 1, 3, 1))),
    "iekf": Style("#775522", (0, (9, 2))),
    "riekf": Style("#0077BB", (0, (4, 1, 1, 1))),
    "causal": Style("#CC9900", (0, (2, 1))),
    "batch": Style("#882288", (0, (7, 1, 1, 1, 1, 1))),
    "isam2": Style("#AAAA00", (0, (3, 3))),
    "gtsam-batch": Style("#4477AA", (0, (10, 2, 2, 2))),
    BOUND: Style("#000000", (0, (1, 1))),
    HINDSIGHT_BOUND: Style("#777777", (0, (1, 2))),
}
USER_STYLES = (
    Style("#332288", (0, (4, 2))),
    Style("#999933", (0, (6, 1, 2, 1))),
    Style("#EE7733", (0, (1.5, 0.8))),
    Style("#AA3377", (0, (3, 2, 1, 2))),
    Style("#44AA99", (0, (8, 1, 1, 1))),
    Style("#555555", (0, (2, 2))),
)


def styles(names: Iterable[str]) -> dict[str, Style]:
    """Return a style for each name; other names take `USER_STYLES` in turn."""
    users = cycle(USER_STYLES)
    return {name: STYLES.get(name) or next(users) for name in names}


class Sheet(NamedTuple):
    """Width and file formats of figures."""

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


SHEET: ContextVar[Sheet] = ContextVar("SHEET", default=Sheet())  # noqa: B039 a tuple does not change


@contextmanager
def printed_on(chosen: Sheet) -> Generator[None]:
    """Use the sheet for all figures of the block."""
    token = SHEET.set(chosen)
    try:
        yield
    finally:
        SHEET.reset(token)


@contextmanager
def printed(path: Path, height: float, title: str = "") -> Generator[Figure]:
    """Yield a new figure of a height [in] in the print style, and write it at the end (see `save_printed`)."""
    inches = SHEET.get().inches
    with mpl.rc_context(PRINT):
        figure = Figure(figsize=(inches, height), layout="constrained")
        lines = [textwrap.fill(line, int(CHARACTERS * inches)) for line in title.splitlines()]
        figure.suptitle("\n".join(lines))
        yield figure
        save_printed(figure, path)


def save_printed(figure: Figure, path: Path) -> None:
    """Write the figure in the formats of the sheet (png at 200 dpi); files contain no date."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)  # it places the parts, once for all formats
        figure.set_layout_engine(None)  # with "none" each format would be drawn twice
    for form in SHEET.get().formats:
        figure.savefig(path.with_suffix(f".{form}"), metadata=UNDATED[form])


def legend_below(figure: FigureBase, handles: Sequence[Any]) -> None:
    """Draw a legend below all axes of the figure, in rows of about equal length."""
    inches, count = SHEET.get().inches, max(len(handles), 1)
    longest = max((len(each.get_label()) for each in handles), default=0)
    by_width, by_text = int(inches / ENTRY), int(CHARACTERS * inches) // (longest + 6)
    rows = math.ceil(count / max(min(by_width, by_text), 1))
    figure.legend(handles=handles, loc="outside lower center", ncols=math.ceil(count / rows))
