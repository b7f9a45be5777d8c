"""The command line: estimators of one's own that fail, or are not there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.reference.command_line import Module, Refuse, run

ESTIMATE = "from slamgauge import Estimate\nimport numpy as np\nimport sys\n\ndef estimate(recording):\n    "


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (
            ESTIMATE + "raise KeyError('gain\\nof\\nthe filter')",
            r"it raised KeyError: .*gain.* \(OWN.py, line 6\); mend it",
        ),
        (ESTIMATE + "raise RuntimeError('a\\nb')", r"it raised RuntimeError: a b \(OWN.py, line 6\); mend it"),
        (ESTIMATE + "return None", "returned a NoneType; return a slamgauge.Estimate"),
        (ESTIMATE + "return recording.odometry", "returned a ndarray; return a slamgauge.Estimate"),
        (
            ESTIMATE + "return Estimate('filtered', np.zeros((5, 3)))",
            "returned 5 poses; return 151, one for the start and one for every step",
        ),
        (
            ESTIMATE + "return Estimate('filtered', np.zeros((151, 3)), association=[-1])",
            r"association has 1 entries; return \d+, one for every observation",
        ),
        (
            ESTIMATE + "return Estimate('filtered', np.full((151, 3), np.nan))",
            r"it raised UserError: poses\[0\] = \[nan, nan, nan\]: .* \(OWN.py, line 6\); mend it and run again",
        ),
        (
            ESTIMATE + "recording.odometry[0] = 0.0",
            r"it raised ValueError: assignment destination is read-only \(OWN.py, line 6\)",
        ),
        (ESTIMATE + "recording.stamps += 1.0", r"it raised ValueError: .*read-only \(OWN.py, line 6\)"),
        (ESTIMATE + "recording.odometry = None", r"it raised FrozenInstanceError: .* \(OWN.py, line 6\)"),
        (ESTIMATE + "sys.exit(0)", r"it raised SystemExit: 0 \(OWN.py, line 6\); mend it and run again"),
        (ESTIMATE + "sys.exit()", r"it raised SystemExit: \(no message\) \(OWN.py, line 6\)"),
        ("import sys\nsys.exit(0)", r"cannot be loaded, it raised SystemExit: 0 \(OWN.py, line 2\)"),
        ("def estimate(recording)\n", r"cannot be loaded, it raised SyntaxError: .*OWN.py, line 1\)"),
        ("1 / 0", r"cannot be loaded, it raised ZeroDivisionError: division by zero \(OWN.py, line 1\)"),
        ("import nowhere_at_all", r"cannot be loaded, it raised ModuleNotFoundError: .* \(OWN.py, line 1\)"),
        ("def estimates(recording): ...", "OWN has no 'estimate'; did you mean estimates?"),
        ("", "OWN has no 'estimate'; name a callable Recording -> Estimate of that module"),
        ("estimate = 3", "is a int; give a callable Recording -> Estimate"),
    ],
)
def test_estimators_that_fail(
    stored: Path,
    refuse: Refuse,
    module: Module,
    source: str,
    message: str,
    capsys: pytest.CaptureFixture[str],
):
    """Alone they are a mistake in one line; beside others they are a row with that line as its reason."""
    own = module(source)
    reason = f"estimator {own}:estimate: {message.replace('OWN', own)}.*"
    line = refuse.line("evaluate", stored / "recording.npz", "--estimators", f"{own}:estimate")
    assert re.fullmatch(reason, line)
    assert run("evaluate", stored / "recording.npz", "--estimators", f"dead-reckoning,{own}:estimate") == 1
    head, ours, row, *notes = capsys.readouterr().out.splitlines()
    assert head.split()[0] == "estimator"
    assert ours.split()[:2] == ["dead-reckoning", "filtered"]
    assert row.split()[:2] == [f"{own}:estimate", "failed"]
    assert any(re.fullmatch(reason, note) for note in notes)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("nowhere_at_all:estimate", "no module 'nowhere_at_all' is found; run in its folder or install it"),
        ("nowhere.at.all:estimate", "no module 'nowhere' is found; "),
        (":estimate", "write FILE.py:callable or module:callable, for example my_filter.py:estimate"),
        (".relative:estimate", "cannot be loaded, it raised TypeError"),
    ],
)
def test_import_paths_that_lead_nowhere(stored: Path, refuse: Refuse, module: Module, path: str, message: str):
    module("")
    assert message in refuse.line("evaluate", stored / "recording.npz", "--estimators", path)
