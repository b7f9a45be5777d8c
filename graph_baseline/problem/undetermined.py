"""Errors that name an undetermined landmark or pose, and the remedy."""

from __future__ import annotations

import re
from collections.abc import Generator
from contextlib import contextmanager

from slamgauge.arrays import Float
from slamgauge.errors import UserError


class UndeterminedError(UserError):
    """The measurements do not determine the optimum, or it was not reached.

    Attributes:
        path: (N+1, 3) last path of a search that did not converge.
    """

    path: Float | None = None


@contextmanager
def explained() -> Generator[None]:
    """Convert GTSAM's error about an indeterminate system to an UndeterminedError with variable and remedy."""
    try:
        yield
    except RuntimeError as error:
        variable = re.search(r"\b([lx])(\d+)\b", str(error))
        if variable is None:
            raise UndeterminedError(
                f"graph: GTSAM stopped ({str(error).strip().splitlines()[0]}); check the recording's covariances"
            ) from None
        raise undetermined_variable(variable[1], int(variable[2])) from None


def undetermined_variable(kind: str, index: int) -> UndeterminedError:
    """Return the error for landmark (`l`) or pose (`x`) number `index`."""
    if kind == "l":
        return UndeterminedError(
            f"landmark {index}: its observations do not determine its position; "
            "add observations with smaller covariances or from other places, or drop its observations"
        )
    return UndeterminedError(
        f"pose {index}: odometry and observations do not determine it; "
        f"give prior_cov and odometry_cov[{max(index - 1, 0)}] smaller variances"
    )
