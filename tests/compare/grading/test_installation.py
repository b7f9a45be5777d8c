"""Files of slamgauge that change while submissions run are found."""

from __future__ import annotations

import compileall
import os
import shutil
from importlib.util import spec_from_file_location
from pathlib import Path

import pytest

from slamgauge.compare.grading import installation
from slamgauge.compare.grading.installation import installed_files, require_same
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a package that is checked instead of slamgauge; its bytecode is not written yet."""
    folder = tmp_path / "package"
    shutil.copytree(Path(installation.__file__).parent, folder, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "kernel.nbc").write_bytes(b"code")
    spec = spec_from_file_location("package", folder / "__init__.py", submodule_search_locations=[str(folder)])
    monkeypatch.setattr(installation, "PACKAGES", ("package",))
    monkeypatch.setattr(installation, "find_spec", {"package": spec}.get)
    return folder


def test_files_that_slamgauge_writes_itself_are_no_change(package: Path):
    before = installed_files()
    assert any(path.suffix == ".pyc" for path in before)
    (package / "__pycache__" / "other.nbc").write_bytes(b"compiled meanwhile")
    require_same(before)


def test_a_touched_source_and_bytecode_of_another_python_are_no_change(package: Path):
    before = installed_files()
    os.utime(package / "grades.py", (1e9, 1e9))
    compileall.compile_dir(package, quiet=2)
    (package / "__pycache__" / "grades.cpython-399.pyc").write_bytes(b"code")
    require_same(before)


@pytest.mark.parametrize("name", ["grades.py", "new.py", "__pycache__/grades.*.pyc", "__pycache__/kernel.nbc"])
def test_changed_code_is_named(package: Path, name: str):
    before = installed_files()
    (path,) = [*package.glob(name)] or [package / name]
    path.write_bytes(b"import evil")
    with pytest.raises(UserError, match="was changed while submissions ran, so their grades may be wrong; install"):
        require_same(before)


def test_removed_code_is_named(package: Path):
    before = installed_files()
    (package / "__pycache__" / "kernel.nbc").unlink()
    with pytest.raises(UserError, match=r"kernel\.nbc: was changed"):
        require_same(before)
