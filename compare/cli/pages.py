"""The page that commands write beside their results."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.storage.result_files import REPORT

NoReport = Annotated[bool, tyro.conf.arg(help=f"Write no {REPORT} beside the results.")]
Open = Annotated[bool, tyro.conf.arg(help=f"Open {REPORT} in the browser.")]


def write_page(out: Path | None, beside: str, *, wanted: bool, opened: bool) -> bool:
    """Write the page of the results that the file `beside` in `out` tells of; whether it is there, if it is wanted.

    A page that fails costs nothing but the page.
    """
    if out is None or not wanted:
        return True
    from slamgauge.compare.report.publishing import write_pages
    from slamgauge.compare.storage.decorations import decorate

    drawn = decorate(out, beside, {"report": lambda stage: write_pages(stage, out, beside)}, [REPORT])
    if drawn and opened:
        open_page(out)
    return drawn


def open_page(folder: Path) -> None:
    """Show the page of a folder in the browser, where there is one."""
    import webbrowser

    if not webbrowser.open((folder / REPORT).resolve().as_uri()):
        print(f"no browser was found; open {folder / REPORT}", file=sys.stderr)
