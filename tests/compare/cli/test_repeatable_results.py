"""Two runs of a command, and `evaluate` after `run`, write equal results, apart from measured times."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from slamgauge.compare.cli.main import main
from tests.reference.command_line import assert_equal_arrays, metrics_of
from tests.reference.fast_commands import studies_in_a_thread

pytestmark = pytest.mark.slow

SHORT = ("q1-short-dense", "--set", "trajectory.duration=3")
COMMANDS = (
    ("run", *SHORT, "--estimators", "ekf,causal", "--out", "run"),
    ("evaluate", "run/recording.npz", "--estimators", "ekf,causal", "--out", "evaluation"),
    ("study", *SHORT, "--runs", "3", "--estimators", "ekf,riekf", "--jobs", "2", "--out", "study"),
)
WITH_TIMES = {  # every other file is equal byte by byte
    *("run/metrics.json", "run/report.html", "run/estimates/ekf.npz", "run/estimates/causal.npz"),
    *("evaluation/metrics.json", "evaluation/report.html"),
    *("evaluation/estimates/ekf.npz", "evaluation/estimates/causal.npz"),
    *("study/summary.json", "study/study.sqlite"),
}


def without_times(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: without_times(value) for key, value in content.items() if not key.startswith("seconds")}
    return [without_times(each) for each in content] if isinstance(content, list) else content


def test_only_times_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    found: list[dict[str, bytes]] = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        with studies_in_a_thread():
            assert [main([*words]) for words in COMMANDS] == [0] * len(COMMANDS)
        paths = [path for path in (tmp_path / name).rglob("*") if path.is_file()]
        found.append({str(path.relative_to(tmp_path / name)): path.read_bytes() for path in paths})
    first, second = found
    assert first.keys() == second.keys()
    assert {name for name in first if first[name] != second[name]} <= WITH_TIMES <= first.keys()
    for name in WITH_TIMES:
        if name.endswith(".json"):
            assert without_times(json.loads(first[name])) == without_times(json.loads(second[name]))
        if name.endswith(".npz"):
            assert_equal_arrays(*(tmp_path / folder / name for folder in ("first", "second")))
    folders = [tmp_path / "first" / each for each in ("run", "evaluation")]
    for name in ("ekf", "causal"):
        assert_equal_arrays(*(folder / f"estimates/{name}.npz" for folder in folders))
    ran, evaluated = (without_times(metrics_of(folder)) for folder in folders)
    assert [evaluated[key] for key in ("digest", "truth", "scenario", "seed")] == [ran["digest"], True, None, None]
    assert evaluated["estimators"] == ran["estimators"]
