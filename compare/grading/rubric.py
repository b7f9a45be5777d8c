"""Points of a submission by a rubric: weights of accuracy, consistency and checks, with partial credit."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from pydantic import Field

from slamgauge.compare.checks.check import Check
from slamgauge.compare.checks.examination import CHECKS, Verdict, presupposed
from slamgauge.compare.datasets.log_settings import Section, validated
from slamgauge.compare.scoring.intervals import Interval
from slamgauge.compare.storage.files import read_toml, toml_text
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

DEFAULT_TEXT = (files("slamgauge.compare.grading") / "rubric.toml").read_text(encoding="utf-8")
Weight = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Scale(Section):
    """Partial credit for a ratio: all points up to `full`, none from `zero` on, linear between them."""

    weight: Weight
    full: Weight
    zero: Weight

    def share(self, ratio: float | None) -> float:
        """Return the share of the points, 0 to 1; 0 without a ratio."""
        if ratio is None or not ratio < self.zero:
            return 0.0
        return min(1.0, (self.zero - ratio) / (self.zero - self.full))


@dataclass(frozen=True)
class Item:
    """An item of a mark."""

    name: str  # accuracy, consistency, or the name of a check
    points: float  # points that the submission has
    most: float  # points of a right filter; 0 if the item is not judged
    text: str  # figure or reason, one line
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


class Rubric(Section):
    """Weights of the items of a mark."""

    total: Weight  # points of a right filter
    accuracy: Scale  # scale of the ATE divided by the reference's
    consistency: Scale  # scale of the NEES divided by the reference's
    checks: dict[str, Weight]  # weights, the keys are names of checks

    @property
    def needed_checks(self) -> list[Check]:
        """Checks with a weight, and those that they presuppose."""
        weighted = {name for name, weight in self.checks.items() if weight}
        needed = weighted.union(*map(presupposed, weighted))
        return [each for each in CHECKS if each.name in needed]

    def to_toml(self) -> str:
        """Return the file of this rubric."""
        table = self.model_dump()
        return toml_text({"": {"total": table.pop("total")}, **table})

    def mark(
        self,
        ate_ratio: Interval | None,
        nees: Interval | None,
        reference_nees: Interval | None,
        verdicts: Sequence[Verdict],
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
        ate = (None if ate_ratio is None else ate_ratio.mean, "ATE is {:.3g} times the reference's")
        found: list[tuple[str, float, float | None, str]] = []  # name, weight, share or None, text
        for name, scale, (ratio, text) in (
            ("accuracy", self.accuracy, ate),
            ("consistency", self.consistency, _nees_ratio(nees, reference_nees)),
        ):
            text = text.format(ratio) if ratio is not None else text.replace("{:.3g}", "?")
            found.append((name, scale.weight, 0.0 if broken else scale.share(ratio), broken or text))
        for each in verdicts:
            share = None if each.passed is None else float(each.passed)
            found.append((each.name, self.checks[each.name], share, _text(each)))
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

    def nothing(self, reason: str) -> Mark:
        """Return the mark of a submission that could not be run."""
        return Mark((Item("runs", 0.0, self.total, reason),), self.total)


def load_rubric(path: Path | None = None) -> Rubric:
    """Return the rubric of a TOML file; keys that are missing, or all without a file, are those of the default rubric.

    Raises:
        UserError: the file cannot be read, or has an unknown key or an impossible value.
    """
    table = tomllib.loads(DEFAULT_TEXT)
    for key, value in ({} if path is None else read_toml(path)).items():
        is_section = isinstance(value, dict) and isinstance(table.get(key), dict)
        table[key] = table[key] | value if is_section else value
    rubric = validated(Rubric, table, path or "the default rubric")
    for name in rubric.checks:
        if name not in (known := [each.name for each in CHECKS]):
            raise UserError(f"{path}: checks.{name}: unknown key; {did_you_mean(name, known)}")
    for name, scale in (("accuracy", rubric.accuracy), ("consistency", rubric.consistency)):
        if not 1.0 <= scale.full < scale.zero:
            raise UserError(
                f"{path}: {name}: full = {scale.full:g} and zero = {scale.zero:g}; give ratios 1 <= full < zero"
            )
    if not rubric.total or not (rubric.accuracy.weight or rubric.consistency.weight):
        remedy = "give a total above 0, and accuracy or consistency a weight"
        raise UserError(f"{path}: some submissions could have no points at all; {remedy}")
    return rubric


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


def _text(verdict: Verdict) -> str:
    if verdict.passed:
        return "limit of the method: " + verdict.blame if verdict.limit_of_method else "passed"
    figure = "" if verdict.figure is None else f"{verdict.figure:.2g} instead of at most {verdict.bound:g}: "
    return f"{figure}{verdict.blame}"
