"""`slamgauge doctor`: its findings, and missing and broken libraries."""

from __future__ import annotations

import json
from importlib.metadata import version
from unittest.mock import Mock

import pytest

from slamgauge import __version__
from slamgauge.compare.cli import doctor
from slamgauge.compare.cli.main import main

pytestmark = pytest.mark.slow


def test_versions_and_findings(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["slamgauge"].startswith(f"{__version__}, ")
    assert {name: found[name] for name in doctor.LIBRARIES} == {name: version(name) for name in doctor.LIBRARIES}
    assert "OPENBLAS_NUM_THREADS=3" in found["threads"]
    parts = {"BLAS": "numpy: ", "filter kernels": "ready in ", "graph kernels": "ready in ", "machine code": " files, "}
    assert not [name for name, part in parts.items() if part not in found[name]]


def test_a_missing_or_broken_library_is_a_line_and_exit_status_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(doctor.LIBRARIES, "no-such-library", doctor.MISSING)
    monkeypatch.setattr("slamgauge.graph_baseline.causal", Mock(side_effect=ImportError("libx.so:\nwrong ELF class")))
    assert main(["doctor"]) == 1
    lines = {"no-such-library  missing", "graph kernels   broken: ImportError: libx.so: wrong ELF class"}
    assert lines < {*capsys.readouterr().out.splitlines()}
