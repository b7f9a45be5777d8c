"""Sizes of the test run."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sizes import FULL, NOT_QUICK, size_of

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("beginning", [*NOT_QUICK, *FULL])
def test_every_beginning_is_that_of_a_test(beginning: str):
    file, _, name = beginning.partition("::")
    files = [path for path in (ROOT / "tests").rglob("test_*.py") if path.relative_to(ROOT).as_posix().startswith(file)]
    assert files
    assert f"def {name.partition('[')[0]}" in files[0].read_text() or not name


@pytest.mark.parametrize(
    ("test", "size"),
    [
        ("tests/core/test_se2.py::test_exp", "quick"),
        ("tests/compare/cli/test_cli.py::test_run", "usual"),
        ("tests/compare/cli/test_cli.py::test_victoria_park", "full"),
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
