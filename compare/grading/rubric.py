"""Points of a submission by a rubric: weights of accuracy, consistency and checks, with partial credit."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from slamgauge.compare.checks.check import Check
from slamgauge.compare.checks.examination import CHECKS, Verdict, presupposed
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.storage.toml_tables import read_toml
from slamgauge.ekf.setting_rules import is_number
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

DEFAULT_TEXT = (files("slamgauge.compare.grading") / "rubric.toml").read_text(encoding="utf-8")
ACCURACY, CONSISTENCY = "accuracy", "consistency"
ATE = "ATE is {:.3g} times the reference's"
CONTENT: dict[str, tuple[str, ...]] = {
    ACCURACY: ("weight", "full", "zero"),
    CONSISTENCY: ("weight", "full", "zero"),
    "checks": tuple(each.name for each in CHECKS),
}


@dataclass(frozen=True)
class Scale:
    """Partial credit for a ratio: all points up to `full`, none from `zero` on, linear between them."""

    weight: float
    full: float
    zero: float

    def share(self, ratio: float | None) -> float:
        """Return the share of the points, 0 to 1; 0 without a ratio."""
        if ratio is None or not ratio < self.zero:
            return 0.0
        return min(1.0, (self.zero - ratio) / (self.zero - self.full))


@dataclass(frozen=True)
class Item:
    """An item of a mark.

    Attributes:
        name: accuracy, consistency, or the name of a check.
        points: points that the submission has.
        most: points of a right filter; 0 if the item is not judged.
        text: figure or reason, one line.
        is_judged: whether the item counts.
    """

    name: str
    points: float
    most: float
    text: str
    is_judged: bool = True


@dataclass(frozen=True)
class Mark:
    """Points of a submission; `total` are those of a right filter."""

    items: tuple[Item, ...]
    total: float

    @property
    def points(self) -> float:
        """Sum of the points of all items, to a hundredth."""
        return round(sum(each.points for each in self.items), 2)


@dataclass(frozen=True)
class Rubric:
    """Weights of the items of a mark.

    Attributes:
        total: points of a right filter.
        accuracy: scale of the ATE divided by that of the reference.
        consistency: scale of the NEES divided by that of the reference.
        checks: weight of each check, by its name.
        text: its TOML file.
    """

    total: float
    accuracy: Scale
    consistency: Scale
    checks: Mapping[str, float]
    text: str

    @property
    def needed_checks(self) -> list[Check]:
        """Checks with a weight, and those that they presuppose."""
        weighted = {name for name, weight in self.checks.items() if weight}
        needed = weighted.union(*map(presupposed, weighted))
        return [each for each in CHECKS if each.name in needed]

    def mark(
        self,
        ate_ratio: Interval | None,
        nees: Interval | None,
        reference_nees: Interval | None,
        verdicts: list[Verdict],
        broken: str = "",
    ) -> Mark:
        """Return the points of a submission that was run.

        Args:
            ate_ratio: ATE divided by that of the reference.
            nees: NEES/3 of the submission, None without covariances.
            reference_nees: NEES/3 of the reference.
            verdicts: results of the checks; checks that are missing or not judged are left out.
            broken: why accuracy and consistency have no points, for example smoothed poses; empty if they have.
        """
        ate = None if ate_ratio is None else ate_ratio.mean
        ratio, how = _nees_ratio(nees, reference_nees)
        found: list[tuple[str, float, float | None, str]] = [
            (ACCURACY, self.accuracy.weight, *_scaled(self.accuracy, ate, ATE, broken)),
            (CONSISTENCY, self.consistency.weight, *_scaled(self.consistency, ratio, how, broken)),
        ]
        for each in verdicts:
            share = None if each.passed is None else float(each.passed)
            found.append((each.name, self.checks[each.name], share, _text(each)))
        return self._shared(found)

    def nothing(self, reason: str) -> Mark:
        """Return the mark of a submission that could not be run."""
        return Mark((Item("runs", 0.0, self.total, reason),), self.total)

    def _shared(self, found: list[tuple[str, float, float | None, str]]) -> Mark:
        """Share the total among the items (name, weight, share or None, text) that are judged."""
        weights = sum(weight for _, weight, share, _ in found if share is not None)
        unit = self.total / weights if weights else 0.0
        items = (
            Item(name, unit * weight * share, unit * weight, text)
            if share is not None
            else Item(name, 0.0, 0.0, text, is_judged=False)
            for name, weight, share, text in found
            if weight
        )
        return Mark(tuple(items), self.total)


def load_rubric(path: Path | None = None) -> Rubric:
    """Return the rubric of a TOML file; None is the default rubric.

    Raises:
        UserError: the file cannot be read, or has an unknown key or an impossible value.
    """
    default = tomllib.loads(DEFAULT_TEXT)
    if path is None:
        return _rubric(default, DEFAULT_TEXT)
    given = read_toml(path)
    _require_keys(path, "", given, ("total", *CONTENT))
    for section, keys in CONTENT.items():
        table = given.get(section, {})
        if not isinstance(table, dict):
            raise UserError(f"{path}: {section} is not a section; write [{section}] above its keys")
        _require_keys(path, f"{section}.", table, keys)
    merged = default | {"total": given.get("total", default["total"])}
    merged |= {section: default[section] | given.get(section, {}) for section in CONTENT}
    for section in (merged, *(merged[name] for name in CONTENT)):
        for key, value in section.items():
            if not isinstance(value, dict) and not (is_number(value) and 0 <= value < math.inf):
                raise UserError(f"{path}: {key} = {value!r} is not a weight; give a number >= 0")
    rubric = _rubric(merged, path.read_text(encoding="utf-8-sig"))
    for name, scale in ((ACCURACY, rubric.accuracy), (CONSISTENCY, rubric.consistency)):
        if not 1.0 <= scale.full < scale.zero:
            raise UserError(
                f"{path}: {name}: full = {scale.full:g} and zero = {scale.zero:g}; give ratios 1 <= full < zero"
            )
    if not rubric.total or not (rubric.accuracy.weight or rubric.consistency.weight):
        remedy = "give a total above 0, and accuracy or consistency a weight"
        raise UserError(f"{path}: some submissions could have no points at all; {remedy}")
    return rubric


def _rubric(table: dict[str, Any], text: str) -> Rubric:
    return Rubric(
        float(table["total"]),
        Scale(**table[ACCURACY]),
        Scale(**table[CONSISTENCY]),
        {name: float(weight) for name, weight in table["checks"].items()},
        text,
    )


def _require_keys(path: Path, section: str, table: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            raise UserError(f"{path}: unknown key {section}{key}; {did_you_mean(key, known)}")


def _nees_ratio(nees: Interval | None, reference: Interval | None) -> tuple[float | None, str]:
    """Return how many times the NEES is too far from 1, compared with the reference, and the text for it.

    A NEES above 1 is divided by that of the reference if that is above 1, too; a NEES below 1 divides that of the
    reference if that is below 1, too.
    """
    if nees is None:
        return None, "it returns no pose_covs, or the NEES is not finite"
    other = 1.0 if reference is None else reference.mean
    if nees.mean >= 1.0:
        return nees.mean / max(other, 1.0), "NEES is {:.3g} times the reference's"
    return min(other, 1.0) / max(nees.mean, 1e-300), "NEES is below 1, {:.3g} times as far as the reference's"


def _scaled(scale: Scale, ratio: float | None, text: str, broken: str) -> tuple[float, str]:
    """Return the share of the points, and the text with the ratio."""
    if broken:
        return 0.0, broken
    return scale.share(ratio), text.format(ratio) if ratio is not None else text.replace("{:.3g}", "?")


def _text(verdict: Verdict) -> str:
    if verdict.passed:
        return "limit of the method: " + verdict.blame if verdict.limit_of_method else "passed"
    return verdict.blame
