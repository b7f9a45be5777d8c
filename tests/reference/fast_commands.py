"""Commands without worker processes and without drawing, which take most of their time."""

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
    """Run studies in a thread of this process, because a worker process takes two seconds to start."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(executors, "local_processes", one_thread)
        yield


@contextmanager
def one_thread(_: int) -> Generator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


@contextmanager
def empty_pictures() -> Generator[None]:
    """Write empty files for figures, which are not rendered; frames of animations are rendered."""
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
