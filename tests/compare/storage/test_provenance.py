"""Results record version, command and scenario, which reproduce them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamgauge import __version__, load_scenario, shipped_scenarios
from slamgauge.compare.cli.main import main
from slamgauge.compare.scenarios.scenario import scenario_text
from slamgauge.compare.storage.provenance import origin

SHORT = ["--set", "trajectory.duration=1", "start=sampled"]


@pytest.mark.parametrize("name", [name for name, _ in shipped_scenarios()])
def test_the_text_of_a_scenario_gives_the_same_scenario(name: str, tmp_path: Path):
    scenario = load_scenario(name, ["start=sampled", "association.map_management=true"])
    (tmp_path / f"{name}.toml").write_text(scenario_text(scenario), encoding="utf-8")
    assert load_scenario(tmp_path / f"{name}.toml") == scenario


@pytest.mark.usefixtures("studies_in_a_thread", "empty_pictures")
def test_metrics_and_summary_contain_version_command_and_scenario(tmp_path: Path):
    run = ["run", "q1-short-dense", "--estimators", "ekf", *SHORT, "--out", str(tmp_path / "a run")]
    study = ["study", "q1-short-dense", "--runs", "2", "--estimators", "ekf", "--jobs", "1", *SHORT]
    assert main(run) == 0
    assert main([*study, "--out", str(tmp_path / "study")]) == 0
    expected = scenario_text(load_scenario("q1-short-dense", SHORT[1:]))
    for path, start in (("a run/metrics.json", "slamgauge run"), ("study/summary.json", "slamgauge study")):
        content = json.loads((tmp_path / path).read_text(encoding="utf-8"))
        assert content["version"] == __version__
        assert content["command"].startswith(f"{start} q1-short-dense --")
        assert content["scenario_text"] == expected
    assert "'" in json.loads((tmp_path / "a run/metrics.json").read_text(encoding="utf-8"))["command"]
    assert origin(None)["command"] is None
