"""Scenarios called as no picture, page or file likes it: everything is written all the same."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from slamgauge.compare.cli.main import main
from slamgauge.compare.storage.safe_names import file_name, shown

NAMES = (r"cost $\frac$", "bad\udcff", "red\x1b[31m", "<b onclick=alert(1)>&amp;", "n" * 240)
SHORT = 'extends = "q1-long-dense"\n[trajectory]\nduration = 1.0\n'
COMMANDS = {
    "run": (("--estimators", "ekf"), "metrics.json", "figure.svg"),
    "study": (("--runs", "2", "--jobs", "1", "--estimators", "ekf"), "summary.json", "nees.svg"),
    "budget": (("--runs", "2", "--jobs", "1"), "budget.json", "budget.svg"),
}


@pytest.mark.usefixtures("studies_in_a_thread")
@pytest.mark.parametrize(
    ("command", "name"), [*(("run", name) for name in NAMES), *((each, NAMES[0]) for each in ("study", "budget"))]
)
def test_a_scenario_of_any_name_is_carried_out_and_drawn(
    command: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    scenario, out = tmp_path / f"{name}.toml", tmp_path / "out"
    scenario.write_text(SHORT, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    words, content, picture = COMMANDS[command]
    where = ("--out", str(out))
    if command == "run":  # its folder is named after the scenario
        out, where = tmp_path / "results" / f"{file_name(shown(name))}-seed-0", ()
    assert main([command, scenario.name, *words, *where]) == 0
    assert "\x1b" not in "".join(capsys.readouterr())
    told = json.loads((out / content).read_text(encoding="utf-8"))["scenario"]
    assert told.isprintable()
    ElementTree.parse(out / picture)
