"""Sizes of the test run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.sizes import FULL, NOT_QUICK, size_of

ROOT = Path(__file__).parents[1]


TESTS = [
    f"{path.relative_to(ROOT).as_posix()}::{name}"
    for path in (ROOT / "tests").rglob("test_*.py")
    for name in ("", *re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE))
]


@pytest.mark.parametrize("beginning", [*NOT_QUICK, *FULL])
def test_every_beginning_is_that_of_a_test(beginning: str):
    without_parameters = beginning.partition(r"\[")[0]
    assert [test for test in TESTS if re.match(without_parameters, test)]


@pytest.mark.parametrize(
    ("test", "size"),
    [
        ("tests/core/test_se2.py::test_exp", "quick"),
        ("tests/compare/cli/test_cli.py::test_run", "usual"),
        ("tests/compare/cli/test_cli.py::test_victoria_park", "full"),
        ("tests/ekf/test_filters_against_textbook.py::test_equals_the_textbook[oc-ekf-1-slip-position]", "usual"),
        ("tests/ekf/test_filters_against_textbook.py::test_equals_the_textbook[oc-ekf-2-slip-position]", "full"),
    ],
)
def test_sizes_of_tests(test: str, size: str):
    assert size_of(test) == size


@pytest.mark.parametrize(
    "file",
    [
        "ekf/test_textbook.py",
        "ekf/test_laws.py",
        "ekf/test_filters_against_textbook.py",
        "ekf/kernels/test_jacobians.py",
        "graph_baseline/test_gtsam_batch.py",
        "compare/checks/test_examination.py",
    ],
)
def test_references_and_laws_are_in_the_usual_run(file: str):
    assert (ROOT / "tests" / file).is_file()
    assert size_of(f"tests/{file}::test_name") != "full"
