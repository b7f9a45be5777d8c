"""The result of a reader of robots' logs, and steps that several readers share."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.text_lines import Line
from slamgauge.covariances import scale_of
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.truth import Truth


class Imported(NamedTuple):
    """A log, its truth, notes about content that was dropped, and the mapping in force for CSV files."""

    recording: Recording
    truth: Truth | None = None
    notes: tuple[str, ...] = ()
    mapping: dict[str, dict[str, Any]] | None = None


@contextmanager
def of_file(path: Path) -> Generator[None]:
    """Add the path to errors of a record that is made from a file."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def require_covariances(
    lines: Sequence[Line], matrices: Float, what: str, remedy: str, *, definite: bool = True
) -> None:
    """Refuse the first line whose matrix (n, d, d), scaled to a correlation, is not positive (semi-)definite."""
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    smallest = np.linalg.eigvalsh(matrices / scale_of(matrices))[:, 0]
    good = (variances > 0.0).all(axis=1) & (smallest > 1e-12) if definite else smallest >= -1e-9
    if not good.all():
        named = "positive definite" if definite else "positive semi-definite"
        raise lines[int(np.argmin(good))].refused(f"{what} is not {named}", remedy)


def identified(landmark: Int) -> tuple[Int | None, Marks, tuple[str, ...]]:
    """Turn ids (M,) that may be -1 into those of a recording: if some observations have an id, the others are dropped.

    Returns:
        The ids of the kept observations, None if no observation has one; the kept observations (M,); and a note about
        the dropped ones.
    """
    known = landmark >= 0
    if not known.any():
        return None, np.ones(len(landmark), dtype=bool), ()
    lost = int(np.sum(~known))
    notes = (f"{lost} of {len(landmark)} observations have no id and are dropped",) if lost else ()
    return landmark[known], known, notes


def steps_of(moves: Sequence[Line], seen: Sequence[Line]) -> Int:
    """Return the step (M,) of each observation: the number of moves above its line."""
    return np.searchsorted([line.number for line in moves], [line.number for line in seen])


def diagonal_covariances(sigmas: Float) -> Float:
    """Return diagonal covariances (n, d, d) of standard deviations (n, d)."""
    return sigmas[:, :, None] ** 2 * np.eye(sigmas.shape[1])


def require_sigmas(**sigmas: float) -> None:
    """Refuse a standard deviation (an option) that is not a number > 0; that of a motion may be 0."""
    for name, sigma in sigmas.items():
        if not 0.0 <= sigma < np.inf or (sigma == 0.0 and name in ("range", "bearing")):
            raise UserError(f"{name.replace('_', '-')}: {sigma:g} is not a standard deviation; give a number > 0")


def require_max_range(max_range: float) -> None:
    """Refuse a largest range [m] (an option) that is not above 0; it may be infinite."""
    if not max_range > 0.0:
        raise UserError(f"max-range: {max_range:g} m excludes every landmark; give metres above 0")
