"""A new clone of the project, installed as in README: imports from the root of the clone."""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
IMPORTS = "import slamgauge.ekf, slamgauge.compare; from slamgauge import SlamFilter; print(SlamFilter.__name__)"


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a clone and a virtual environment that uses the dependencies of this one, without downloads."""
    clone = tmp_path_factory.mktemp("clone") / "slamgauge-clone"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False).stdout
    if not tracked:
        pytest.skip("the project is not a git checkout")
    for name in filter(None, tracked.split("\0")):
        if (ROOT / name).exists():
            (clone / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, clone / name)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", clone / ".venv"], check=True)
    packages = run(clone, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip()
    Path(packages, "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    pip = ["-m", "pip", "--quiet", "install", "--no-index", "--no-deps", "--no-build-isolation", "--ignore-installed"]
    done = run(clone, *pip, "-e", ".")
    assert done.returncode == 0, done.stderr
    return clone


def run(clone: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the Python of the clone in the root of the clone."""
    command = [clone / ".venv/bin/python", *arguments]
    return subprocess.run(command, cwd=clone, capture_output=True, text=True, check=False)


def output(clone: Path, *arguments: str) -> str:
    done = run(clone, *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip()


def test_the_packages_are_imported_from_the_root_of_the_clone(clone: Path):
    assert output(clone, "-c", IMPORTS) == "SlamFilter"
    place = output(clone, "-c", "import slamgauge; print(slamgauge.__file__)")
    assert clone in Path(place).parents


def test_python_m_slamgauge_runs_in_the_root_of_the_clone(clone: Path):
    import slamgauge

    assert slamgauge.__version__ in output(clone, "-m", "slamgauge", "--version")
