"""Pages: their contents, and the HTML of a page as one file with style sheet, script and data.

The template engine escapes all data. The Content-Security-Policy allows only the style sheet and the script of
slamgauge, by their digests, so a browser runs no other code and uses no network.
"""

from __future__ import annotations

import base64
import hashlib
import importlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from numpy.typing import ArrayLike

from slamgauge.compare.figures.plot_style import styles
from slamgauge.compare.scoring.table import Table, sized
from slamgauge.compare.storage.result_files import BUDGET, GRADES, METRICS, NOISE, REPORT, SUMMARY, SWEEP, shown
from slamgauge.version import __version__

# function of a folder of results, for each main file, that returns its page, or its pages by file name; it is imported
# when it is needed, because it imports this module
PAGES = {
    METRICS: "run_pages:run_page",
    SUMMARY: "study_pages:study_page",
    SWEEP: "study_pages:sweep_page",
    BUDGET: "study_pages:budget_page",
    GRADES: "grade_page:grade_pages",
    NOISE: "run_pages:noise_page",
}
ASSETS = files("slamgauge.compare.report") / "assets"
# each module imports only modules before it
MODULES = (
    *("unpack", "colours", "surface", "ticks", "download", "tables", "panel", "camera", "scene", "timeline", "player"),
    *("replay", "start"),
)
KINDS = {"f4": "<f4", "i4": "<i4", "u2": "<u2", "u1": "u1"}  # numpy types by their names in `unpack.js`
IMPORT = re.compile(r"^import .*;\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=function|class|const)", re.MULTILINE)
LONGEST_DASH = 12.0  # line widths


class Line(NamedTuple):
    """Sentence of a list, with the name of what it is about."""

    name: str
    text: str
    link: str = ""


class Picture(NamedTuple):
    """Picture inside the page; its caption is its alternative text, too."""

    source: str
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
    data: dict[str, Any] = field(default_factory=dict)  # JSON for the scripts


def said(texts: Iterable[str]) -> list[Line]:
    """Return sentences that are about no estimator."""
    return [Line("", text) for text in texts]


def looks(names: Iterable[str], hidden: Iterable[str] = ()) -> list[Look]:
    """Return the colours and dashes of the figures for these estimators."""
    found, off = list[Look](), {*hidden}
    for name, style in styles(names).items():
        lengths = () if isinstance(style.dashes, str) else style.dashes[1]
        dashes = tuple(min(float(each), LONGEST_DASH) for each in lengths)
        found.append(Look(name, style.color, dashes, name not in off))
    return found


def pictures(folder: Path, captions: Mapping[str, str]) -> list[Picture]:
    """Return the pictures in a folder that have captions, by file name."""
    found = [(folder / name, caption) for name, caption in captions.items() if (folder / name).is_file()]
    return [Picture(f"data:image/png;base64,{_base64(path.read_bytes())}", caption) for path, caption in found]


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


def render(page: Page) -> str:
    """Return the HTML of a page, with a glossary of its terms and of the columns of its tables."""
    style, script = _read("page.css"), program()
    tables = [table for section in page.sections for table in section.tables if table.rows]
    columns = [(head.full, head.help) for table in tables for head in table.heads if head.help]
    glossary = dict.fromkeys([*page.terms, *columns])
    policy = (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src '{_digest(style)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )
    content = vars(page) | {
        "data": Markup(json_text(page.data)),  # escaped by json_text
        "sections": [section for section in page.sections if section],
        "version": __version__,
        "style": Markup(style),  # trusted: part of slamgauge
        "script": Markup(script),  # trusted: part of slamgauge
        "policy": policy,
        "glossary": [*glossary],
    }
    return _environment().get_template("page.html").render(content)


def json_text(data: dict[str, Any]) -> str:
    """Return JSON in which no text can end a script element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def program() -> str:
    """Return all modules as one script, in the order of their imports, without import and export statements."""
    texts = (_read(f"modules/{name}.js") for name in MODULES)
    return "\n".join(EXPORT.sub("", IMPORT.sub("", text)) for text in texts)


def pack(values: ArrayLike, kind: Literal["f4", "i4", "u2", "u1"] = "f4") -> dict[str, Any]:
    """Encode an array row by row for `unpack.js`; single precision (relative 1e-7) is enough for a screen."""
    content = np.ascontiguousarray(values, dtype=KINDS[kind])
    return {"kind": kind, "data": _base64(content.tobytes())}


def _read(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{_base64(hashlib.sha256(text.encode()).digest())}"


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("slamgauge.compare.report", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        finalize=lambda value: shown(value) if type(value) is str else value,  # without unprintable characters
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["sized"] = sized
    return environment


def write_pages(stage: Path, pages: dict[str, str]) -> None:
    """Write pages, HTML texts by name, into the folder `stage`."""
    for name, text in pages.items():
        (stage / name).parent.mkdir(exist_ok=True)
        (stage / name).write_text(text, encoding="utf-8", newline="\n")


def pages_of(main: Path) -> dict[str, str]:
    """Return the pages of results, HTML texts by file name; `main` is their main file.

    Raises:
        UserError: the folder of `main` has no such results, or its files belong to different ones.
    """
    module, _, name = PAGES[main.name].partition(":")
    made = getattr(importlib.import_module(f"slamgauge.compare.report.{module}"), name)(main.parent)
    by_file: dict[str, Page] = made if isinstance(made, dict) else {REPORT: made}
    return {file: render(page) for file, page in by_file.items()}
