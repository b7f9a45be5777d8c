"""Render a page from a template: one HTML file with style sheet, script and data.

The template engine escapes all data. The Content-Security-Policy allows only the style sheet and the script of
slamgauge, by their digests, so a browser runs no other code and uses no network.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import fields
from functools import cache
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from numpy.typing import ArrayLike

from slamgauge.compare.report.page_elements import Page
from slamgauge.compare.scoring.table import sized
from slamgauge.compare.storage.safe_names import shown
from slamgauge.version import __version__

ASSETS = files("slamgauge.compare.report") / "assets"
# each module imports only modules before it
MODULES = (
    *("unpack", "colours", "surface", "ticks", "download", "tables", "panel", "camera", "scene", "timeline", "player"),
    *("replay", "start"),
)
TERMS = {
    "run": (
        ("causal optimum", "best estimate from the measurements up to each step, with the true noise (causal)"),
        ("hindsight optimum", "best estimate from all measurements (batch)"),
        (
            "3-sigma ellipse",
            "region that contains the true position with probability 98.9 % if the covariance is right",
        ),
    ),
    "study": (
        ("\u00b1", "half the width of the 95 % interval of the mean over runs"),
        ("band", "interval of the mean for consistent estimates, at the stated level"),
    ),
}
KINDS = {"f4": "<f4", "i4": "<i4", "u2": "<u2", "u1": "u1"}  # numpy types by their names in `unpack.js`
IMPORT = re.compile(r"^import .*;\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=function|class|const)", re.MULTILINE)


def render(page: Page) -> str:
    """Return the HTML of a page, with a glossary of its terms and of the columns of its tables."""
    style, script = style_sheet(), program()
    content = {each.name: getattr(page, each.name) for each in fields(page)}
    content["data"] = Markup(json_text(page.data))  # escaped by json_text
    content["sections"] = [section for section in page.sections if section]
    heads = [head for section in page.sections for table in section.tables if table.rows for head in table.heads]
    glossary = dict.fromkeys([*page.terms, *((head.full, head.help) for head in heads if head.help)])
    return (
        _environment()
        .get_template("page.html")
        .render(
            content,
            version=__version__,
            style=Markup(style),  # trusted: part of slamgauge
            script=Markup(script),  # trusted: part of slamgauge
            policy=policy(style, script),
            glossary=[*glossary],
        )
    )


def policy(style: str, script: str) -> str:
    """Return a Content-Security-Policy that allows only this style sheet, this script and inline pictures."""
    return (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src '{_digest(style)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def json_text(data: dict[str, Any]) -> str:
    """Return JSON in which no text can end a script element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def style_sheet() -> str:
    """Return the style sheet of all pages."""
    return _read("page.css")


@cache
def program() -> str:
    """Return all modules as one script, in the order of their imports, without import and export statements."""
    texts = (_read(f"modules/{name}.js") for name in MODULES)
    return "\n".join(EXPORT.sub("", IMPORT.sub("", text)) for text in texts)


def pack(values: ArrayLike, kind: Literal["f4", "i4", "u2", "u1"] = "f4") -> dict[str, Any]:
    """Encode an array row by row for `unpack.js`; single precision (relative 1e-7) is enough for a screen."""
    content = np.ascontiguousarray(values, dtype=KINDS[kind])
    return {"kind": kind, "data": base64.b64encode(content.tobytes()).decode("ascii")}


def _read(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}"


@cache
def _environment() -> Environment:
    loader = PackageLoader("slamgauge.compare.report", "templates")
    environment = Environment(
        loader=loader,
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        finalize=_printable,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["sized"] = sized
    return environment


def _printable(value: object) -> object:
    """Replace unprintable characters in texts; the template engine escapes markup afterwards."""
    return shown(value) if type(value) is str else value
