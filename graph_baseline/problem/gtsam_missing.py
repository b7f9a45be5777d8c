"""Where GTSAM is imported by who cannot do without it."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager

from slamgauge.errors import UserError


@contextmanager
def gtsam_needed(otherwise: str) -> Generator[None]:
    """Around an import of what needs GTSAM: where there is none, a line that names who does `otherwise`.

    Raises:
        UserError: there is no GTSAM on this system.
    """
    try:
        yield
    except ImportError as error:
        why = str(error).splitlines()[0]
        raise UserError(f"needs GTSAM, which cannot be had here ({why}); {otherwise} does without it") from None
