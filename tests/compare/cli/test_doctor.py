"""`slamgauge doctor`: what it finds, what it makes of what is missing or broken, and that it clears up."""

from __future__ import annotations

import importlib
import json
from importlib.metadata import version
from pathlib import Path

import pytest

from slamgauge import __version__, kernel_cache
from slamgauge.compare.cli import machine
from slamgauge.compare.cli.main import main


def test_versions_and_what_works_of_them(capsys: pytest.CaptureFixture[str]):
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["slamgauge"].startswith(f"{__version__}, ")
    assert {name: found[name] for name in machine.LIBRARIES} == {name: version(name) for name in machine.LIBRARIES}
    assert found["BLAS"].startswith("numpy: ")
    assert "OPENBLAS_NUM_THREADS=1" in found["threads"]
    assert found["filter kernels"].startswith("ready in ")
    assert found["graph kernels"].startswith("ready in ")
    assert " files, " in found["kept machine code"]
    assert found["free memory"].endswith(" GB")
    assert {"Python", "system", "browser", "ffmpeg", "distributed"} < {*found}


def test_the_table_has_a_line_for_each(capsys: pytest.CaptureFixture[str]):
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["slamgauge", f"{__version__},", str(Path(machine.__file__).parents[2])]
    assert len(lines) == len(machine.examine())


def test_what_is_missing_is_a_line_and_exit_status_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(machine, "LIBRARIES", ("numpy", "no-such-library"))
    assert main(["doctor"]) == 1
    assert "no-such-library    missing" in capsys.readouterr().out.splitlines()


def test_what_is_broken_is_a_line_and_exit_status_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def refuse() -> None:
        raise ImportError("libgtsam.so:\nwrong ELF class")

    monkeypatch.setattr("slamgauge.graph_baseline.solver.warm_up.compile_graphs_once", refuse)
    assert main(["doctor"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "graph kernels      broken: ImportError: libgtsam.so: wrong ELF class" in lines


def test_kept_machine_code_is_removed_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    for name in ("models.observe-12.py311.nbi", "models.observe-12.py311.1.nbc", "models.cpython-311.pyc"):
        (tmp_path / name).touch()
    for module, _ in machine.WARM_UPS.values():
        importlib.import_module(module)  # from here on their folders are known
    monkeypatch.setattr(kernel_cache, "_folders", {tmp_path})
    assert main(["doctor", "--clear-cache"]) == 0
    out, error = capsys.readouterr()
    assert error == "kept machine code: 2 files removed\n"
    assert f"kept machine code  0 files, 0.0 MB, {tmp_path}" in out.splitlines()
    assert [path.name for path in tmp_path.iterdir()] == ["models.cpython-311.pyc"]
