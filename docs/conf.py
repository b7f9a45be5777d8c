"""How Sphinx makes one site of this folder: `sphinx-build docs build/site`, and with `-t online` links elsewhere."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

import slamgauge

project = "slamgauge"
version = release = slamgauge.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
if tags.has("online"):  # noqa: F821  Sphinx puts it here
    extensions.append("sphinx.ext.intersphinx")  # it fetches lists of names, which a check must not depend on
intersphinx_mapping = {
    "python": ("https://docs.python.org/3", None),
    "numpy": ("https://numpy.org/doc/stable", None),
    "scipy": ("https://docs.scipy.org/doc/scipy", None),
    "matplotlib": ("https://matplotlib.org/stable", None),
}
highlight_language = "none"  # blocks without a language are outputs, not Python
html_theme = "furo"
html_title = f"slamgauge {release}"
html_static_path = ["static"]
html_css_files = ["narrow.css"]
html_copy_source = False
html_show_search_summary = False  # it fetches the pages, which browsers refuse of files
html_show_copyright = False
myst_heading_anchors = 3  # levels of headings that links may name
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"  # fields of a dataclass are listed once
autodoc_type_aliases = {name: name for name in ("Float", "Int", "Marks", "ArrayLike")}
add_module_names = False  # signatures read `ekf_slam(recording, ...)`
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True  # `settings=FilterSettings()`, not all its fields
napoleon_use_ivar = True  # dataclasses name their fields in their docstring and in their body

ALIAS = re.compile(r"TypeAliasForwardRef(?:<[^>]+>)*\((?:<[^>]+>)*'(\w+)'(?:<[^>]+>)*\)(?:</span>)?")


def skipped(_app: Sphinx, _kind: str, name: str, member: object, *_: object) -> bool | None:
    """Leave out fields of named tuples, which have no text, and pydantic's setting of a class."""
    return True if name == "model_config" or str(member.__doc__).startswith("Alias for") else None


def with_names(_app: Sphinx, _page: str, _template: str, context: dict[str, Any], _tree: object) -> None:
    """Print the alias of a union as `Int | None`; Sphinx 9.0 prints the object that stands for it."""
    if "body" in context:
        context["body"] = ALIAS.sub(r"\1", context["body"])


def setup(app: Sphinx) -> None:
    """Connect the functions of this file."""
    app.connect("autodoc-skip-member", skipped)
    app.connect("html-page-context", with_names)
