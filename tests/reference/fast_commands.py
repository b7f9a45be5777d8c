"""Commands without what takes most of their time and is not what a test is about: worker processes, and drawing."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from slamgauge.compare.studies import executors

SAVE = Figure.savefig


@contextmanager
def studies_in_a_thread() -> Generator[None]:
    """A thread of this process carries every run: a worker process takes two seconds to begin."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(executors, "local_processes", one_thread)
        yield


@contextmanager
def one_thread(_: int) -> Generator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


@contextmanager
def empty_pictures() -> Generator[None]:
    """Figures are made, but not rendered: their files are empty. Frames of animations are."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Figure, "savefig", unrendered)
        yield


def unrendered(figure: Figure, target: Any, **how: Any) -> None:
    if how.get("format") == "rgba":  # a frame of an animation
        SAVE(figure, target, **how)
    elif isinstance(target, Path):
        target.write_bytes(b"")
    else:
        target.write(b"<svg/>")
