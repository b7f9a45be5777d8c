"""`slamgauge doctor`: its findings, missing and broken libraries, and --clear-cache."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from unittest.mock import Mock

import pytest

from slamgauge import __version__, jit
from slamgauge.compare.cli import doctor
from slamgauge.compare.cli.main import main

pytestmark = pytest.mark.slow


def test_versions_and_findings(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["slamgauge"].startswith(f"{__version__}, ")
    assert {name: found[name] for name in doctor.LIBRARIES} == {name: version(name) for name in doctor.LIBRARIES}
    assert found["BLAS"].startswith("numpy: ")
    assert "OPENBLAS_NUM_THREADS=3" in found["threads"]
    assert found["filter kernels"].startswith("ready in ")
    assert found["graph kernels"].startswith("ready in ")
    assert " files, " in found["kept machine code"]
    assert found["free memory"].endswith(" GB")
    assert {"Python", "system", "browser", "distributed"} < {*found}


@pytest.mark.parametrize(
    ("changed", "value", "line"),
    [
        ("compare.cli.doctor.LIBRARIES", ("numpy", "no-such-library"), "no-such-library    missing"),
        (
            "graph_baseline.causal",
            Mock(side_effect=ImportError("libgtsam.so:\nwrong ELF class")),
            "graph kernels      broken: ImportError: libgtsam.so: wrong ELF class",
        ),
    ],
)
def test_a_missing_or_broken_library_is_a_line_and_exit_status_1(
    changed: str, value: object, line: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(f"slamgauge.{changed}", value)
    assert main(["doctor"]) == 1
    assert line in capsys.readouterr().out.splitlines()


def test_only_stored_machine_code_is_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    for name in ("models.observe-12.py311.nbi", "models.observe-12.py311.1.nbc", "models.cpython-311.pyc"):
        (tmp_path / name).touch()
    monkeypatch.setattr(jit, "caches", lambda: tmp_path)
    assert main(["doctor", "--clear-cache"]) == 0
    out, error = capsys.readouterr()
    assert error == "kept machine code: 2 files removed\n"
    assert f"kept machine code  0 files, 0.0 MB, {tmp_path}" in out.splitlines()
    assert [path.name for path in tmp_path.iterdir()] == ["models.cpython-311.pyc"]
