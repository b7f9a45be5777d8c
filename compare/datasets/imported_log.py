"""The result of a reader of robots' logs, and functions that several readers use."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgauge.arrays import Float, Int, Marks
from slamgauge.compare.storage.text_lines import Line
from slamgauge.covariances import scale_of
from slamgauge.errors import UserError
from slamgauge.recording import Recording
from slamgauge.se2 import chain
from slamgauge.truth import Truth

BEGINNING = 5.0  # m of a path, whose direction suggests the heading of the start


class Imported(NamedTuple):
    """An imported log.

    Attributes:
        recording: measurements.
        truth: true path and map; None if the log has no truth.
        notes: sentences about dropped content.
        mapping: settings with which CSV files were read (`csv_mapping`); None for other files.
        unmatched: number of observations that were dropped because they are outside the odometry's time.
    """

    recording: Recording
    truth: Truth | None = None
    notes: tuple[str, ...] = ()
    mapping: dict[str, dict[str, Any]] | None = None
    unmatched: int = 0


@contextmanager
def of_file(path: Path | str) -> Generator[None]:
    """Return a context that adds the path of a file to the text of each UserError."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{path}: {error}") from None


def require_covariances(
    lines: Sequence[Line], matrices: Float, what: str, remedy: str, *, definite: bool = True
) -> None:
    """Raise UserError at the first line whose matrix is not a covariance.

    Args:
        lines: (n,) lines of the file.
        matrices: (n, d, d) matrix of each line. Its correlation matrix is tested.
        what: name of the matrix in the error.
        remedy: end of the error text.
        definite: whether the matrix must be positive definite; otherwise semi-definite is sufficient.
    """
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    smallest = np.linalg.eigvalsh(matrices / scale_of(matrices))[:, 0]
    good = (variances > 0.0).all(axis=1) & (smallest > 1e-12) if definite else smallest >= -1e-9
    if not good.all():
        named = "positive definite" if definite else "positive semi-definite"
        raise lines[int(np.argmin(good))].refused(f"{what} is not {named}", remedy)


def identified(landmark: Int) -> tuple[Int | None, Marks, tuple[str, ...]]:
    """Drop observations without an id from a log in which other observations have one.

    Args:
        landmark: (M,) id of each observation, -1 without one.

    Returns:
        The ids of the kept observations, None if no observation has an id; a mask (M,) of the kept observations; and a
        note about the dropped observations. Without any id, all observations are kept.
    """
    known = landmark >= 0
    if not known.any():
        return None, np.ones(len(landmark), dtype=bool), ()
    lost = int(np.sum(~known))
    notes = (f"{lost} of {len(landmark)} observations have no id and are dropped",) if lost else ()
    return landmark[known], known, notes


def numbered(ids: Sequence[int | str | None], stated: Mapping[str, int], where: str) -> tuple[Int, dict[str, int]]:
    """Return ids (M,) as numbers, -1 for None, and the numbers of texts.

    Texts of digits are numbers. Another text has the number that is stated. If no number is stated, texts are numbered
    in alphabetical order, after the largest id that is a number.
    """
    ids = [int(each) if isinstance(each, str) and each.isdecimal() else each for each in ids]
    texts = sorted({each for each in ids if isinstance(each, str)})
    if not texts:
        return np.array([-1 if each is None else each for each in ids], dtype=np.int64), dict(stated)
    first = 1 + max((each for each in ids if isinstance(each, int)), default=-1)
    table = dict(stated) or {text: number for number, text in enumerate(texts, max(first, 0))}
    missing = [text for text in texts if text not in table]
    if missing:
        raise UserError(f"{where}: the id {missing[0]!r} has no number; add it to [ids], or leave [ids] out")
    numbers = [-1 if each is None else table[each] if isinstance(each, str) else each for each in ids]
    return np.array(numbers, dtype=np.int64), table


def start_pose(stated: Sequence[float] | None, truth: Float | None, odometry: Float) -> tuple[Float, tuple[str, ...]]:
    """Return the start pose (3,), as stated, else the true one, else the origin, and notes.

    Args:
        stated: x, y [m] and heading [rad], if they are stated.
        truth: (N+1, 3) true poses; headings may be NaN.
        odometry: (N, 3) increments, which suggest a heading.

    Raises:
        UserError: the truth does not begin at the start.
    """
    if stated is not None:
        return np.array(stated, dtype=np.float64), ()
    if truth is None:
        return np.zeros(3), ()
    if np.isnan(truth[0, 0]):
        raise UserError("start.pose: the ground truth has no pose at the start; state it, or cut the log")
    if not np.isnan(truth[0, 2]):
        return truth[0], ()
    start = np.array([*truth[0, :2], 0.0])
    driven = chain(start, odometry) - start
    near = np.cumsum(np.hypot(*np.diff(driven[:, :2], axis=0).T)) < BEGINNING
    ours, theirs = driven[1:, :2][near], truth[1:, :2][near] - start[:2]
    dot, cross = np.nansum(ours * theirs), np.nansum(ours[:, 0] * theirs[:, 1] - ours[:, 1] * theirs[:, 0])
    x, y, heading = *start[:2], np.arctan2(cross, dot)
    fit = f"the first {BEGINNING:g} m suggest {heading:.3g} rad (--set start.pose=[{x:.6g},{y:.6g},{heading:.3g}])"
    return start, (f"the ground truth has no headings: the start has the heading 0; {fit}",)


def diagonal_covariances(sigmas: Float) -> Float:
    """Return diagonal covariances (n, d, d) with standard deviations (n, d)."""
    return sigmas[:, :, None] ** 2 * np.eye(sigmas.shape[1])


def with_sigmas(covs: Float, sigmas: Sequence[Float | float | None]) -> Float:
    """Return covariances (n, d, d) with stated standard deviations of d axes; None keeps variance and correlations."""
    covs = covs.copy()
    for axis, sigma in enumerate(sigmas):
        if sigma is not None:
            covs[:, axis, :], covs[:, :, axis] = 0.0, 0.0
            covs[:, axis, axis] = np.square(sigma)
    return covs


def require_sigmas(**sigmas: float) -> None:
    """Raise UserError for an option that is not a standard deviation: a finite number > 0, or >= 0 for a motion."""
    for name, sigma in sigmas.items():
        if not 0.0 <= sigma < np.inf or (sigma == 0.0 and name in ("range", "bearing")):
            raise UserError(f"{name.replace('_', '-')}: {sigma:g} is not a standard deviation; give a number > 0")


def require_max_range(max_range: float) -> None:
    """Raise UserError unless the option `max-range` [m] is above 0; it may be infinite."""
    if not max_range > 0.0:
        raise UserError(f"max-range: {max_range:g} m excludes every landmark; give metres above 0")
