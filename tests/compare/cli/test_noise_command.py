"""`slamgauge noise`: its table and files, and its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamgauge import load_recording, load_scenario, save, simulate
from slamgauge.compare.cli.main import main

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = ["trajectory.duration=10", "start=sampled", "assumed.scale=4"]
    path = tmp_path_factory.mktemp("log") / "log.npz"
    save(path, simulate(load_scenario("q1-short-dense", settings), 2)[1])
    return path


def test_it_prints_writes_and_finds_the_same_again(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, tuned = tmp_path / "out", tmp_path / "tuned" / "log.npz"
    assert main(["noise", str(log), "--out", str(out), "--write", str(tuned)]) == 0
    printed = capsys.readouterr().out
    assert printed.split()[:2] == ["noise", "found"]
    assert "times too large" in printed
    content = json.loads((out / "noise.json").read_text())
    assert {"parameters", "outlier_rate", "systematic", "nis_by_channel", "log_likelihood_gain"} < content.keys()
    sigma = content["parameters"]["range"]
    assert sigma["low"] < sigma["sigma"] < sigma["high"] < sigma["assumed"] == pytest.approx(0.2)
    np.testing.assert_allclose(load_recording(tuned).observation_cov[:, 0, 0], sigma["sigma"] ** 2)
    assert (out / "noise.png").read_bytes().startswith(b"\x89PNG")
    assert (out / "noise.svg").is_file()
    assert main(["noise", str(tuned), "--write", str(tuned.with_name("again.npz")), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["log_likelihood_gain"] == pytest.approx(0.0, abs=0.1)


def test_mistakes_are_one_line(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "mine.npz").write_bytes(b"mine")
    cases = (
        (["--write", str(log)], f"{log}: is the recording itself; give another --write"),
        (["--write", str(tmp_path / "mine.npz")], "mine.npz: exists already; move it away or give another name"),
    )
    for words, message in cases:
        assert main(["noise", str(log), *words]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert message in printed.err
        assert printed.err.count("\n") == 1
    assert (tmp_path / "mine.npz").read_bytes() == b"mine"
    assert main(["noise", str(tmp_path / "mine.npz")]) == 2
