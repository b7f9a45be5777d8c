"""`slamgauge explain`: every word of tables, checks, estimators and scenarios has a meaning; near misses are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.checks.examination import CHECKS
from slamgauge.compare.cli.explain import explanations
from slamgauge.compare.cli.glossary import TERMS
from slamgauge.compare.cli.main import main
from slamgauge.compare.estimators.registry import BOUNDS, REGISTRY
from slamgauge.compare.scenarios.schema import Scenario
from slamgauge.compare.scoring.catalogue import CATALOGUE, FULL_NAMES

PAGE = (Path(__file__).parents[3] / "docs/glossary.md").read_text(encoding="utf-8")

STUDY = dict.fromkeys(("NEES in 99.9% band", "final sigma / optimum", "chi2/dof", "fit of the model", "Q, R"))


@pytest.mark.parametrize("words", [FULL_NAMES, FULL_NAMES.values(), REGISTRY, BOUNDS, Scenario.model_fields, STUDY])
def test_every_word_has_a_meaning(words: dict[str, object]):
    for word in words:
        assert ": " in " ".join(explanations(word))


def test_checks_and_keys_in_sections_have_a_meaning():
    for word in (*(check.name for check in CHECKS), "association.gate", "landmarks.random.count", "fis.gate"):
        assert " ".join(explanations(word)).startswith(f"{word} (")
    assert "probation" not in " ".join(explanations("fis.gate"))
    assert " ".join(explanations("freiburg-course")).startswith("freiburg-course (scenario): ")


def test_a_verdict_is_explained_as_it_was_printed():
    assert explanations("claims 1.6 times too small a sigma") == explanations("claims N times too small a sigma")
    assert explanations("1.13 ± 0.11 times the causal optimum's error")[0].startswith("N ± N times ")


@pytest.mark.parametrize(("word", "near"), [("NESS", "nees"), ("x optimun", "x optimum"), ("asociation.gate", "gate")])
def test_a_near_miss_is_one_line_with_the_word(word: str, near: str, capsys: pytest.CaptureFixture[str]):
    assert main(["explain", word]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert near in message.partition("did you mean")[2]


def test_the_page_has_the_rows_of_the_catalogue_and_the_glossary():
    for section, terms in TERMS.items():
        rows = "".join(f"| *{term}* | {meaning} |\n" for term, meaning in terms.items())
        assert f"\n## {section}\n\n| term | meaning |\n|---|---|\n{rows}" in PAGE
    for each in CATALOGUE:
        if each.column is not None:
            assert f"| *{each.column.name or each.column.title}* |" in PAGE
            assert f"| `{each.key}` | {each.help} |\n" in PAGE
