"""Render a page from a template: one HTML file with style sheet, script and data.

The template engine escapes all data. The Content-Security-Policy allows only the style sheet and the script of
slamgauge, by their digests, so a browser runs no other code and uses no network.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from slamgauge.compare.storage.safe_names import shown
from slamgauge.version import __version__

ASSETS = files("slamgauge.compare.report") / "assets"
# each module imports only modules before it
MODULES = (
    *("unpack", "colours", "surface", "ticks", "download", "tables", "panel", "camera", "scene", "timeline", "player"),
    *("replay", "strip", "study", "start"),
)
IMPORT = re.compile(r"^import .*;\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=function|class|const)", re.MULTILINE)


def render(template: str, *, data: dict[str, Any] | None = None, **content: Any) -> str:
    """Return the HTML of a template; `data` is JSON for the script of the page."""
    style, script = style_sheet(), program()
    return (
        _environment()
        .get_template(template)
        .render(
            version=__version__,
            style=Markup(style),  # trusted: part of slamgauge
            script=Markup(script),  # trusted: part of slamgauge
            policy=policy(style, script),
            data=Markup(json_text(data or {})),  # escaped by json_text
            **content,
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


def data_source(content: bytes, kind: str) -> str:
    """Return content as a data URL."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _read(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}"


@cache
def _environment() -> Environment:
    loader = PackageLoader("slamgauge.compare.report", "templates")
    return Environment(
        loader=loader,
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        finalize=_printable,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _printable(value: object) -> object:
    """Replace unprintable characters in texts; the template engine escapes markup afterwards."""
    return shown(value) if type(value) is str else value
