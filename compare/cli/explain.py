"""Meanings of columns, terms, verdicts, estimators, checks and scenario keys: `slamgauge explain`."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

import tyro

from slamgauge.compare.cli.glossary import TERMS
from slamgauge.compare.cli.terminal import put
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

WIDTH = 88


@dataclass
class Explain:
    """Explain a column, a term, a verdict, an estimator, a check or a key of a scenario.

    For example:
      slamgauge explain NEES
      slamgauge explain "x optimum"
      slamgauge explain association.gate
    """

    word: tyro.conf.Positional[tuple[str, ...]]
    """A word, or several."""

    def __call__(self) -> int:
        return 0 if put("\n".join(explanations(" ".join(self.word)))) else 1


def explanations(word: str) -> list[str]:
    """Return the lines that explain a word; upper and lower case are the same.

    Raises:
        UserError: the word is not known; the message names similar ones.
    """
    known: dict[str, list[str]] = {}
    for name, meaning in _meanings():
        found = known.setdefault(name.lower(), [])
        if meaning not in found:
            found.append(meaning)
    wanted = word.strip().lower()
    if wanted not in known:  # a verdict has its numbers where its row has N
        wanted = re.sub(r"\d[\d.]*", "n", wanted)
    if wanted not in known:
        otherwise = "see docs/glossary.md for columns and terms"
        raise UserError(f"{word!r} is not known; {did_you_mean(wanted, known, otherwise, most=3)}")
    return [line for each in known[wanted] for line in textwrap.wrap(each, WIDTH, subsequent_indent="  ")]


def _meanings() -> Iterator[tuple[str, str]]:
    """Yield names and meanings; a name may occur more than once."""
    from slamgauge.compare.checks.examination import CHECKS
    from slamgauge.compare.estimators.registry import BOUNDS, REGISTRY
    from slamgauge.compare.report.tables import ESTIMATOR, KIND
    from slamgauge.compare.scenarios.scenario import shipped_scenarios
    from slamgauge.compare.scenarios.schema import Scenario
    from slamgauge.compare.scoring.catalogue import CATALOGUE

    for section, terms in TERMS.items():
        for names, meaning in terms.items():
            for name in dict.fromkeys((names, *names.split(", "))):
                yield name, f"{names} ({section.lower()}): {meaning}"
    for head in (ESTIMATOR, KIND):
        yield head.title, f"{head.title} (column): {head.help}"
    for each in CATALOGUE:
        column = each.column
        titles = () if column is None else tuple(dict.fromkeys((column.name or column.title, column.title)))
        for name in (each.key, *titles, *(title.partition(" [")[0] for title in titles)):
            yield (
                name,
                f"{titles[0]} (column; in files {each.key}): {each.help}" if titles else f"{each.key}: {each.help}",
            )
    for name, entry in (REGISTRY | BOUNDS).items():
        summary = inspect.cleandoc(inspect.getdoc(entry.load()) or "").partition("\n\n")[0]
        yield name, f"{name} (estimator): {' '.join(summary.split())}"
    for check in CHECKS:
        yield check.name, f"{check.name} (check): {check.figure}, at most {check.bound:g}. If it fails: {check.blame}"
    yield from ((name, f"{name} (scenario): {description}") for name, description in shipped_scenarios())
    yield from _keys(Scenario)


def _keys(section: type, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the keys of a section of scenarios and of the sections in it, each with the text of its section."""
    from slamgauge.compare.scenarios.section import Section

    described = inspect.cleandoc(section.__doc__ or "")
    for key, field in section.model_fields.items():
        kinds = [field.annotation, *get_args(field.annotation)]
        kinds += [inner for each in kinds for inner in get_args(each)]
        sections = [each for each in kinds if isinstance(each, type) and issubclass(each, Section)]
        place = f"{prefix}{key}"
        default = "" if field.is_required() or sections else f"; default {field.default!r}"
        own = re.search(rf"^    {key}: (.*?)(?=^    \w+: |\Z)", described, re.DOTALL | re.MULTILINE)
        text = f"{place} (key of a scenario{default}): {' '.join((own[1] if own else described).split())}"
        if not sections:
            yield from ((place, text), (key, text))
        for each in sections:
            summary = " ".join((each.__doc__ or "").partition("Attributes:")[0].split())
            yield place, f"{place} (section of a scenario): {summary}"
            yield from _keys(each, f"{place}.")
