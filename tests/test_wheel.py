"""The wheel contains only the program, and works without the source tree."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath
from zipfile import ZipFile

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = {"core": "", "ekf": "ekf", "graph_baseline": "graph_baseline", "compare": "compare"}
KINDS = ("*.py", "*.toml", "*.html", "*.css", "*.js", "*.mplstyle", "py.typed")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a copy of the tree, because a build writes files there and uses older ones."""
    folder = tmp_path_factory.mktemp("wheel")
    passing = (".*", "__pycache__", "*.egg-info", "build", "dist", "results")
    source = shutil.copytree(ROOT, folder / "source", ignore=shutil.ignore_patterns(*passing))
    arguments = ["-m", "build", "--wheel", "--no-isolation", "--outdir", folder / "dist", source]
    done = subprocess.run([sys.executable, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (built,) = (folder / "dist").iterdir()
    return built


def test_the_wheel_contains_only_the_program(wheel: Path):
    with ZipFile(wheel) as archive:
        names = {PurePosixPath(name) for name in archive.namelist()}
    program = {name for name in names if not name.parts[0].endswith(".dist-info")}
    assert program == {
        PurePosixPath("slamgauge", within, file.relative_to(ROOT / folder).as_posix())
        for folder, within in FOLDERS.items()
        for kind in KINDS
        for file in (ROOT / folder).rglob(kind)
    }
    assert wheel.name.endswith("-py3-none-any.whl")
    assert [name.name for name in names - program if "licenses" in name.parts] == ["LICENSE"]


def test_the_unpacked_wheel_runs_a_scenario(wheel: Path, tmp_path: Path):
    with ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "unpacked")
    arguments = ("--set", "trajectory.duration=2", "--estimators", "causal,batch", "--out", "run", "--json")
    program = "import runpy, sys; from slamgauge import ekf; print(ekf.__file__, file=sys.stderr); "
    program += "runpy.run_module('slamgauge', run_name='__main__', alter_sys=True)"
    done = subprocess.run(
        [sys.executable, "-c", program, "run", "q1-short-dense", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "unpacked")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / "unpacked") in done.stderr
    assert set(json.loads(done.stdout)["estimators"]) == {"causal", "batch"}
    assert (tmp_path / "run/figure.svg").exists()
