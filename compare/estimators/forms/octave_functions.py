"""The two functions of the Octave course in a module and its neighbour, and the roles of their parameters."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from slamgauge.compare.estimators.captured_output import stdout_to_stderr
from slamgauge.compare.estimators.forms.signatures import called, required
from slamgauge.compare.estimators.forms.step_source import names_read
from slamgauge.compare.estimators.no_windows import without_windows
from slamgauge.compare.estimators.pair_files import CORRECTIONS, OTHER_FORM, PREDICTIONS, partner_file
from slamgauge.compare.estimators.private_import import folder_of
from slamgauge.compare.estimators.user_code import UserCodeError, reason_of

INPUTS = ("u", "odom", "control", "motion")  # names of u begin so
SCANS = ("z", "obs", "sensor", "meas")  # names of z begin so
MARKS = ("observed", "seen", "known", "visited", "init", "mapped", "book")  # names of `observed` contain one of these
COUNTS = ("n", "numlandmarks", "nlandmarks", "numoflandmarks")  # number of landmarks
FIRST = "first"  # part of the name of a flag for step 1


class CourseFunction(NamedTuple):
    """One of the functions.

    Attributes:
        name: its name.
        function: the function.
        parameters: its required parameters.
        order: positions of mu, sigma, and u or z with `observed` among its parameters.
    """

    name: str
    function: Any
    parameters: list[str]
    order: tuple[int, ...]

    @property
    def name_of_cov(self) -> str:
        """Name of the parameter with the covariance."""
        return self.parameters[self.order[1]]

    def count_globals(self) -> dict[str, int]:
        """Return the integer globals for the number of landmarks that the function reads."""
        space: dict[str, Any] = getattr(self.function, "__globals__", {})
        return {name: space[name] for name in _counts(names_read(self.function)) if type(space.get(name)) is int}

    def __call__(self, values: tuple[object, ...], count: int, *, is_first: bool) -> object:
        """Call it with mu, sigma, and u or z with `observed`; further parameters receive `count` or `is_first`.

        Globals for the number of landmarks, N or num_landmarks, are set to `count`.
        """
        getattr(self.function, "__globals__", {}).update(dict.fromkeys(self.count_globals(), count))
        arguments = [is_first if FIRST in each.lower() else count for each in self.parameters]
        for at, value in zip(self.order, values, strict=True):
            arguments[at] = value  # pyrefly: ignore[unsupported-operation]
        return called(self.function, *arguments)


class CoursePair(NamedTuple):
    """Both functions of the course."""

    predict: CourseFunction
    correct: CourseFunction


def course_pair(names: dict[str, Any]) -> CoursePair | None:
    """Return the functions among the names of a module; the second one may be in a neighbour, which is loaded."""
    predict, correct = _prediction(names), _correction(names)
    if (predict is None) == (correct is None) or OTHER_FORM in names:
        return None if predict is None or correct is None else CoursePair(predict, correct)
    neighbour = _neighbour(names)
    predict, correct = predict or _prediction(neighbour), correct or _correction(neighbour)
    return None if predict is None or correct is None else CoursePair(predict, correct)


def _prediction(names: dict[str, Any]) -> CourseFunction | None:
    for name in PREDICTIONS:
        parameters = required(names.get(name))
        if len(parameters) >= 3 and _are_extra(parameters[3:]):
            u = _position(parameters, INPUTS, 2)
            mu, sigma = (at for at in range(3) if at != u)
            return CourseFunction(name, names[name], parameters, (mu, sigma, u))
    return None


def _correction(names: dict[str, Any]) -> CourseFunction | None:
    for name in CORRECTIONS:
        parameters = required(names.get(name))
        if len(parameters) < 4 or not _are_extra(parameters[4:]):
            continue
        marks = [at for at in range(4) if any(part in parameters[at].lower() for part in MARKS)]
        if not marks and "step" not in name.lower():
            continue  # for example correct(x, P, y, landmark) beside a step function
        observed = marks[-1] if marks else 3
        rest = [at for at in range(4) if at != observed]
        z = rest[_position([parameters[at] for at in rest], SCANS, 2)]
        mu, sigma = (at for at in rest if at != z)
        return CourseFunction(name, names[name], parameters, (mu, sigma, z, observed))
    return None


def _position(parameters: list[str], beginnings: tuple[str, ...], otherwise: int) -> int:
    """Return the position of the only one of three parameters that begins so."""
    found = [at for at in range(3) if parameters[at].lower().startswith(beginnings)]
    return found[0] if len(found) == 1 else otherwise


def _are_extra(parameters: list[str]) -> bool:
    """Return whether values are known for further parameters."""
    return all(FIRST in each.lower() for each in {*parameters} - {*_counts(parameters)})


def _counts(names: Iterable[str]) -> list[str]:
    """Return those of some names that mean the number of landmarks."""
    return [each for each in names if each.lower().replace("_", "") in COUNTS]


def _neighbour(names: dict[str, Any]) -> dict[str, Any]:
    """Load the neighbour with the second function, and return its names; empty if it does not exist.

    Raises:
        UserCodeError: it cannot be loaded.
    """
    folder, file = folder_of(str(names.get("__name__"))), names.get("__file__")
    partner = None if folder is None or not file else partner_file(Path(file))
    if folder is None or partner is None or not folder.offers(partner.stem):
        return {}
    try:
        with stdout_to_stderr(), without_windows():
            return vars(folder.load(partner.stem))
    except (Exception, SystemExit) as error:
        raise UserCodeError(f"its neighbour {partner.name} cannot be loaded, {reason_of(error)}") from error
