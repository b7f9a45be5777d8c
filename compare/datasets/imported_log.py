"""What a reader of robots' logs returns, and what several readers do alike."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.datasets.text_lines import Line
from slamgauge.covariances import scale_of
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.truth import Truth


class Imported(NamedTuple):
    """A log, its truth if it has any, and what of the file is not in them: a line each."""

    recording: Recording
    truth: Truth | None
    notes: tuple[str, ...]


@contextmanager
def of_file(path: Path) -> Generator[None]:
    """Say of which file a record that cannot be made was to be."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def require_covariances(
    lines: Sequence[Line], matrices: Float, what: str, remedy: str, *, definite: bool = True
) -> None:
    """Refuse the first line whose matrix (n, d, d) is not positive (semi-)definite, seen as a correlation."""
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    smallest = np.linalg.eigvalsh(matrices / scale_of(matrices))[:, 0]
    good = (variances > 0.0).all(axis=1) & (smallest > 1e-12) if definite else smallest >= -1e-9
    if not good.all():
        named = "positive definite" if definite else "positive semi-definite"
        raise lines[int(np.argmin(good))].refused(f"{what} is not {named}", remedy)


def identified(landmark: Int) -> tuple[Int | None, Marks, tuple[str, ...]]:
    """Ids (M,) that may be -1, as a recording has them: all known, or none.

    Returns:
        The ids of the observations that are kept, None if there are no ids at all; which are kept, (M,); and what to
        say of those that are not: where some observations have ids, those without are left out.
    """
    known = landmark >= 0
    if not known.any():
        return None, np.ones(len(landmark), dtype=bool), ()
    lost = int(np.sum(~known))
    notes = (f"{lost} of {len(landmark)} observations have no id and are left out",) if lost else ()
    return landmark[known], known, notes


def diagonal_covariances(sigmas: Float) -> Float:
    """Covariances (n, d, d) without correlations, of standard deviations (n, d)."""
    return sigmas[:, :, None] ** 2 * np.eye(sigmas.shape[1])


def require_sigmas(**sigmas: float) -> None:
    """Refuse a standard deviation that is given as an option unless it is a number > 0; of a motion it may be 0."""
    for name, sigma in sigmas.items():
        if not 0.0 <= sigma < np.inf or (sigma == 0.0 and name in ("range", "bearing")):
            raise UserError(f"{name.replace('_', '-')}: {sigma:g} is no standard deviation; give a number > 0")


def require_max_range(max_range: float) -> None:
    """Refuse a range [m] given as an option that nothing would be within; infinity is one."""
    if not max_range > 0.0:
        raise UserError(f"max-range: {max_range:g} m lets nothing be seen; give metres above 0")
