"""A form of user code: its name, how a callable of it is recognised, and the estimator made of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from slamgauge.compare.estimators.fresh_modules import Code, Fresh
from slamgauge.estimate import Estimator
from slamgauge.recording import Recording


class Form(NamedTuple):
    """A form of user code.

    Attributes:
        name: its name for `--form`.
        description: describes a callable of this form; returns None for another.
        estimator: makes an estimator from the code.
        example: its signature, for error messages.
    """

    name: str
    description: Callable[[Fresh], str | None]
    estimator: Callable[[Code], Estimator]
    example: str


def remarks_of(estimator: Estimator, recording: Recording) -> list[str]:
    """Return what users should know about a run of their code on a recording, for example replaced settings.

    The estimator of a form may have a method `remarks(recording) -> list[str]`; it is called after a run.
    """
    remarks: Callable[[Recording], list[str]] | None = getattr(estimator, "remarks", None)
    return [] if remarks is None else remarks(recording)


def replaces_noise(estimator: Estimator) -> bool:
    """Return whether the noise of the recording replaced another noise of the user's file in the last run.

    The estimator of a form whose files may have noise has an attribute of this name.
    """
    return bool(getattr(estimator, "replaces_noise", False))
