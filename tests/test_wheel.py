"""The wheel contains only the program, and works without the source tree."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path, PurePosixPath
from zipfile import ZipFile

import pytest

from tests.reference.installed_copy import PACKAGES, ROOT, lend_kernels, run_in

pytestmark = pytest.mark.slow

SCENARIOS = sorted(path.stem for path in (ROOT / "compare/scenarios").glob("*.toml"))


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


@pytest.fixture(scope="module")
def unpacked(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unpacked")
    with ZipFile(wheel) as archive:
        archive.extractall(folder)
    lend_kernels(folder)
    return folder


def test_the_wheel_contains_only_the_program(wheel: Path):
    with ZipFile(wheel) as archive:
        names = {PurePosixPath(name) for name in archive.namelist()}
    program = {name for name in names if not name.parts[0].endswith(".dist-info")}
    core = ROOT / "core"
    source = {PurePosixPath("slamgauge", file.relative_to(core).as_posix()) for file in core.rglob("*.py")}
    source |= {PurePosixPath("slamgauge/py.typed"), PurePosixPath("slamgauge/paper.mplstyle")}
    for package in PACKAGES:
        kinds = ("*.py", "*.toml", "*.json", "*.html", "*.css", "*.js")
        files = [file for kind in kinds for file in (ROOT / package).rglob(kind)]
        source |= {PurePosixPath("slamgauge", file.relative_to(ROOT).as_posix()) for file in files}
    source.remove(PurePosixPath("slamgauge/compare/report/assets/jsconfig.json"))  # for the type checker of pages
    assert program == source
    assert set(SCENARIOS) >= {"q1-long-dense", "q1-long-sparse", "q1-short-dense"}
    assert wheel.name.endswith("-py3-none-any.whl")
    licences = [name for name in names - program if "licenses" in name.parts]
    assert [name.name for name in licences] == ["LICENSE"]


def python(unpacked: Path, cwd: Path, *arguments: str) -> str:
    """Return the output of Python with the unpacked wheel first on the import path."""
    done = run_in(unpacked, *arguments, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_unpacked_wheel_is_imported(unpacked: Path, tmp_path: Path):
    code = "import json, slamgauge as s; "
    code += "print(json.dumps([module.__file__ for module in (s, s.compare, s.ekf, s.graph_baseline)]))"
    files = [Path(file) for file in json.loads(python(unpacked, tmp_path, "-c", code))]
    assert [unpacked in file.parents for file in files] == [True] * 4


def test_the_unpacked_wheel_finds_its_scenarios(unpacked: Path, tmp_path: Path):
    lines = python(unpacked, tmp_path, "-m", "slamgauge", "scenarios").splitlines()
    assert [line.split()[0] for line in lines] == SCENARIOS


def test_the_unpacked_wheel_runs_a_scenario(unpacked: Path, tmp_path: Path):
    arguments = ("--set", "trajectory.duration=2", "--estimators", "causal,batch", "--out", "run", "--json")
    metrics = json.loads(python(unpacked, tmp_path, "-m", "slamgauge", "run", "q1-short-dense", *arguments))
    assert set(metrics["estimators"]) == {"causal", "batch"}
    assert (tmp_path / "run/figure.svg").exists()
