"""A page out of a template: one file with its style, its program and its data, and a policy that allows nothing else.

Whatever comes from data is escaped by the template engine; the program and the style sheet are ours, and the policy
names them by their digests, so that a browser runs no other, asks no network and sends nothing.
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
# in the order in which they build upon each other
MODULES = (
    *("unpack", "colours", "surface", "ticks", "download", "tables", "panel", "camera", "scene", "timeline", "player"),
    *("replay", "strip", "study", "start"),
)
IMPORT = re.compile(r"^import .*;\n", re.MULTILINE)
EXPORT = re.compile(r"^export (?=function|class|const)", re.MULTILINE)


def render(template: str, *, data: dict[str, Any] | None = None, **content: Any) -> str:
    """The page that a template makes of its content; `data` is what its program reads, plain values of JSON."""
    style, script = style_sheet(), program()
    return (
        _environment()
        .get_template(template)
        .render(
            version=__version__,
            style=Markup(style),  # ours
            script=Markup(script),  # ours
            policy=policy(style, script),
            data=Markup(json_text(data or {})),  # escaped there
            **content,
        )
    )


def policy(style: str, script: str) -> str:
    """The Content-Security-Policy: this style sheet, this program and pictures in the page itself, and no more."""
    return (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src '{_digest(style)}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


def json_text(data: dict[str, Any]) -> str:
    """JSON that may stand within a script element: no text in it ends that."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def style_sheet() -> str:
    """What pages look like."""
    return _read("page.css")


@cache
def program() -> str:
    """The modules as one: each follows those that it imports, so that the names are there without the imports."""
    texts = (_read(f"modules/{name}.js") for name in MODULES)
    return "\n".join(EXPORT.sub("", IMPORT.sub("", text)) for text in texts)


def data_source(content: bytes, kind: str) -> str:
    """The address of a picture that stands in the page itself."""
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
    """Texts without what no page can hold; the engine escapes them afterwards."""
    return shown(value) if type(value) is str else value
