"""A study's table for papers: chosen columns and rows, with or without intervals, and escaped texts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamgauge import UserError
from slamgauge.compare.cli.main import main
from slamgauge.compare.scoring.table import escaped
from slamgauge.compare.studies.stored_study import study_table

pytestmark = pytest.mark.slow


def interval(mean: float) -> dict[str, float]:
    return {"mean": mean, "low": mean - 0.5, "high": mean + 0.5}


@pytest.fixture
def study(tmp_path: Path) -> Path:
    entry = {"runs": 7, "ate_m": interval(1.0), "ratio_to_causal": interval(2.0), "nees_pose_per_dof": interval(3.0)}
    entry |= {"coverage_95": interval(0.9), "seconds_total": {"mean": 1.0}, "landmarks_mapped": None}
    estimators = {"ekf": entry, "a_b|c": entry | {"ate_m": None}}
    content = {"scenario": "my_scene", "runs": 7, "seed": 3, "command": "slamgauge study", "version": "1"}
    content |= {"digest": "", "failures": [], "per_run": {}}
    (tmp_path / "summary.json").write_text(json.dumps(content | {"estimators": estimators}), encoding="utf-8")
    return tmp_path


def test_each_format(study: Path):
    assert study_table(study, "csv", ["ate_m"], []).splitlines() == [
        "estimator,runs,ate_m,ate_m_low,ate_m_high",
        "ekf,7,1.0,0.5,1.5",
        "a_b|c,7,,,",
    ]
    assert study_table(study, "csv", ["ate_m"], ["ekf"], intervals=False) == "estimator,runs,ate_m\nekf,7,1.0\n"
    assert study_table(study, "markdown", ["ate_m", "nees_pose_per_dof"], []).splitlines() == [
        "| estimator | runs | ATE [m] | NEES/3 |",
        "| --- | ---: | ---: | ---: |",
        "| ekf | 7 | 1.000 ± 0.500 | 3.00 ± 0.50 |",
        r"| a_b\|c | 7 | - | 3.00 ± 0.50 |",
    ]
    latex = study_table(study, "latex", [], ["a_b|c"])
    assert r"\begin{tabular}{lrrrrr}" in latex
    assert all(f"\\{rule}rule" in latex for rule in ("top", "mid", "bottom"))
    assert r"\caption{my\_scene, 7 runs (seed 3), means with 95 \% intervals. ATE [m]: " in latex
    assert r"a\_b|c & 7 & - & 2.000 $\pm$ 0.500 & 3.00 $\pm$ 0.50 & 90.0\% $\pm$ 50.0\% \\" in latex
    assert escaped(r"$x^2$ & {~\}#") == r"\$x\textasciicircum{}2\$ \& \{\textasciitilde{}\textbackslash{}\}\#"


@pytest.mark.parametrize(
    ("keys", "estimators", "message"),
    [
        (["ate"], [], "ate: no column of this study; did you mean ate_m?"),
        (["seconds_total"], [], "seconds_total: no column"),  # it has no interval
        ([], ["efk"], "efk: no estimator of this study; did you mean ekf?"),
    ],
)
def test_missing_columns_and_estimators_are_refused(study: Path, keys: list[str], estimators: list[str], message: str):
    with pytest.raises(UserError, match=message.replace("?", r"\?")):
        study_table(study, "csv", keys, estimators)


def test_the_command_prints_or_writes_it(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ["export", "markdown", str(study), "--columns", "ate_m", "--means-only"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert printed.splitlines()[2] == "| ekf | 7 | 1.000 |"
    assert main([*arguments, "--out", str(tmp_path / "tables" / "ate.md")]) == 0
    assert (tmp_path / "tables" / "ate.md").read_text(encoding="utf-8").rstrip() == printed.rstrip()
    assert main(["export", "g2o", str(study)]) == 2
    (study / "summary.json").write_text("[]", encoding="utf-8")
    capsys.readouterr()
    assert main(arguments) == 2
    assert capsys.readouterr().err.count("\n") == 1
