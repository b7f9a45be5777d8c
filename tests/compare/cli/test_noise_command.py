"""`slamgauge noise`: its table and files, and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamgauge import load_recording, load_scenario, save, simulate
from slamgauge.compare.cli.main import main

pytestmark = pytest.mark.slow


def test_it_prints_and_writes_what_it_finds_and_refuses_to_replace_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    settings = ["trajectory.duration=10", "start=sampled", "assumed.scale=4"]
    log, out, tuned = tmp_path / "log.npz", tmp_path / "out", tmp_path / "tuned" / "log.npz"
    save(log, simulate(load_scenario("q1-short-dense", settings), 2)[1])
    assert main(["noise", str(log), "--out", str(out), "--write", str(tuned)]) == 0
    printed = capsys.readouterr()
    assert printed.out.split()[:2] == ["noise", "found"]
    assert "times too large" in printed.out
    assert {*printed.err.splitlines()} == {f"written to {out}", f"written to {tuned}"}
    content = json.loads((out / "noise.json").read_text())
    assert {"parameters", "outlier_rate", "systematic", "nis_by_channel", "log_likelihood_gain"} < content.keys()
    sigma = content["parameters"]["range"]
    assert sigma["low"] < sigma["sigma"] < sigma["high"] < sigma["assumed"] == pytest.approx(0.2)
    np.testing.assert_allclose(load_recording(tuned).observation_cov[:, 0, 0], sigma["sigma"] ** 2)
    assert (out / "noise.svg").is_file()
    for write, message in ((log, "is the recording itself; give another --write"), (tuned, "exists already; move it")):
        assert main(["noise", str(log), "--write", str(write)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"slamgauge: {write}: {message}")
    assert main(["noise", str(tuned), "--write", str(tuned.with_name("again.npz")), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["log_likelihood_gain"] == pytest.approx(0.0, abs=0.1)
