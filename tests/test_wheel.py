"""The wheel contains only the program, and works without the source tree."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
FOLDERS = [ROOT / name for name in ("core", "ekf", "graph_baseline", "compare")]
KINDS = ("*.py", "*.toml", "*.html", "*.css", "*.js", "*.mplstyle", "py.typed")


def test_the_wheel_contains_only_the_program_and_runs_without_the_sources(tmp_path: Path):
    """The wheel is built from a copy of the tree, because a build writes files there and uses older ones."""
    passing = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist", "results")
    source = shutil.copytree(ROOT, tmp_path / "source", ignore=passing)
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path / "dist", source]
    subprocess.run(build, cwd=tmp_path, check=True)
    (wheel,) = (tmp_path / "dist").glob("*-py3-none-any.whl")
    with ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        archive.extractall(tmp_path / "unpacked")
    files = [file.relative_to(ROOT) for folder in FOLDERS for kind in KINDS for file in folder.rglob(kind)]
    assert names == {f"slamgauge/{file.as_posix().removeprefix('core/')}" for file in files}
    code = "import sys; from slamgauge import ekf; from slamgauge.compare.cli.main import main; "
    code += "assert ekf.__file__.startswith(sys.argv[1]); sys.exit(main(sys.argv[2:]))"
    words = "run q1-short-dense --set trajectory.duration=2 --estimators causal,batch --out run"
    command = [sys.executable, "-c", code, str(tmp_path / "unpacked"), *words.split()]
    where = {**os.environ, "PYTHONPATH": str(tmp_path / "unpacked"), "NUMBA_DISABLE_JIT": "1"}  # compiles nothing again
    subprocess.run(command, cwd=tmp_path, env=where, check=True)
    assert (tmp_path / "run/figure.svg").exists() and (tmp_path / "run/report.html").exists()
