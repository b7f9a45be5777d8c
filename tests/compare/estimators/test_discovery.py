"""Without the name of a callable the estimator of a file is found by its name and form, or refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.estimators.adapters import found_in
from slamgauge.compare.estimators.sources import sources_of
from slamgauge.compare.estimators.user_code import Address
from slamgauge.errors import UserError

from .conftest import EXAMPLES

pytestmark = pytest.mark.slow

STEP = "def {}(xEst, PEst, u, y): return xEst, PEst\n"
ONLINE = "class {}:\n    def predict(self, increment, cov): ...\n    def update(self, observations): ...\n"
HELPERS = (
    "import numpy as np\nfrom math import hypot\ndef wrap(angle): return angle\ndef predict(x, P, u): return x, P\n"
)


def found(file: Path) -> str:
    return found_in(Address(file.name, file.stem, str(file), "", sources_of(file.parent, file.stem))).attribute


@pytest.mark.parametrize(
    ("source", "name"),
    [
        (STEP.format("ekf_slam") + "def correct(x, P, yi, landmark): ...\n", "ekf_slam"),
        (STEP.format("my_slam"), "my_slam"),
        ("def estimate(recording): ...\n" + STEP.format("ekf_slam"), "estimate"),
        ("def estimate(x, P, y): ...\n" + STEP.format("ekf_slam"), "ekf_slam"),
        ("def run(recording): ...\n", "run"),
        (ONLINE.format("Mine") + "def correct(x, P, yi, landmark): ...\n", "Mine"),
        (ONLINE.format("Mine") + ONLINE.format("_Base"), "Mine"),
        (
            "def prediction_step(mu, sigma, u): ...\ndef correction_step(mu, sigma, z, observed): ...\n",
            "prediction_step",
        ),
        ("def update(eta, P, z): ...\ndef predict(eta, P, z_odo): ...\n", "predict"),
        (
            "from slamgauge import adapters\n"
            "estimate = adapters.external(['./my_slam', '{recording}', '{estimate}'])\n" + ONLINE.format("Mine"),
            "estimate",
        ),
        (STEP.format("ekf_slam") + "exit()", "ekf_slam"),
    ],
)
def test_the_estimator_is_found(tmp_path: Path, source: str, name: str):
    file = tmp_path / "mine.py"
    file.write_text((HELPERS if "predict" not in source else "") + source)
    assert found(file) == name


def test_an_imported_callable_counts_by_its_name(tmp_path: Path):
    (tmp_path / "core.py").write_text(STEP.format("ekf_slam") + STEP.format("other"))
    (tmp_path / "mine.py").write_text("from core import ekf_slam, other\n")
    assert found(tmp_path / "mine.py") == "ekf_slam"


@pytest.mark.parametrize("name", ["student_ekf", "student_ekf_no_wrap", "own_estimator"])
def test_the_estimators_of_the_examples(name: str):
    assert found(EXAMPLES / f"{name}.py") == ("estimate" if name == "own_estimator" else "ekf_slam")


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (
            STEP.format("one") + STEP.format("other"),
            r"^mine.py: may be one, other; name it, mine.py:one, or call the one that counts estimate$",
        ),
        (
            "def wrap(angle): ...\n",
            r"^mine.py: defines no callable of a form that is known; give estimate\(recording\), ",
        ),
        ("if not open:\n    import numpy\nelse:\n    exit()\n", r"cannot be loaded, it raised SystemExit: None"),
    ],
)
def test_a_file_without_or_with_several_estimators_is_refused(tmp_path: Path, source: str, expected: str):
    (tmp_path / "mine.py").write_text(source)
    with pytest.raises(UserError, match=expected):
        found(tmp_path / "mine.py")
