"""The page that commands write beside their results."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from slamgauge.compare.storage.result_files import REPORT

Open = Annotated[bool, tyro.conf.arg(help=f"Open {REPORT} in the browser.")]


@dataclass(frozen=True)
class PageOptions:
    """The page that explains the results."""

    no_report: bool = False
    """Write no report.html beside the results."""

    open: Open = False


def write_page(out: Path | None, beside: str, page: PageOptions) -> bool:
    """Write the page of the results that the file `beside` in `out` tells of; whether it is there, if it is wanted.

    A page that fails costs nothing but the page.
    """
    if out is None or page.no_report:
        return True
    from slamgauge.compare.report.publishing import PAGES, write_pages
    from slamgauge.compare.storage.best_effort import decorate

    drawn = decorate(out, beside, {"report": lambda stage: write_pages(stage, PAGES[beside](out))}, [REPORT])
    if drawn and page.open:
        open_page(out)
    return drawn


def open_page(folder: Path) -> None:
    """Show the page of a folder in the browser, where there is one."""
    import webbrowser

    if not webbrowser.open((folder / REPORT).resolve().as_uri()):
        print(f"no browser was found; open {folder / REPORT}", file=sys.stderr)
