"""Errors that name an undetermined landmark or pose, or a missing GTSAM, and the remedy."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import NoReturn

from slamgauge.errors import UserError


class UndeterminedError(UserError):
    """The measurements do not determine the optimum, or it was not reached."""


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


def unavailable(name: str, alternative: str, error: ImportError) -> Callable[..., NoReturn]:
    """Return a function `name` that raises a UserError with the import `error` and an `alternative` estimator."""
    reason = str(error).splitlines()[0]

    def missing(*_: object, **__: object) -> NoReturn:
        raise UserError(f"needs GTSAM, which cannot be imported ({reason}); use {alternative}, which does not need it")

    missing.__name__ = name
    return missing
