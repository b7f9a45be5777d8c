"""Machine code that is kept: none outlives its sources, and damage to it costs a compilation.

That all kernels are kept: `tests/ekf/kernels/test_compilation.py`.
"""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core import config

from slamgauge import kernel_cache

HEAD = "from slamgauge.jit import kernel\n{}\n\n@kernel\ndef "
CALLEE = HEAD.format("") + "inside(x):\n    return x + {}\n"
CALLER = HEAD.format("from made_kernels.callee import inside\n") + "outside(x):\n    return inside(x)\n"


def imported(folder: Path) -> Any:
    """Return the calling kernel, imported as by a new program."""
    kernel_cache.sources_digest.cache_clear()
    importlib.invalidate_caches()
    for name in [each for each in sys.modules if each.partition(".")[0] == "made_kernels"]:
        del sys.modules[name]
    for bytecode in (folder / "__pycache__").glob("*.pyc"):
        bytecode.unlink()  # Python ignores an edit of the same length within a second
    return importlib.import_module("made_kernels.caller").outside


def called(folder: Path) -> tuple[int, bool]:
    """Return the result of the calling kernel for 1 in a new program, and whether its code was on disk."""
    outside = imported(folder)
    return outside(1), bool(outside.stats.cache_hits)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder of two modules: a kernel that calls another, compiled and cached."""
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "made_kernels"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "callee.py").write_text(CALLEE.format(1), encoding="utf-8")
    (folder / "caller.py").write_text(CALLER, encoding="utf-8")
    assert called(folder) == (2, False)
    assert called(folder) == (2, True)
    return folder


def kept(folder: Path, suffix: str) -> list[Path]:
    return [*(folder / "__pycache__").glob(f"*.{suffix}")]


def test_a_kernel_that_a_kernel_calls_has_no_machine_code(folder: Path) -> None:
    (folder / "callee.py").write_text(CALLEE.format(2), encoding="utf-8")
    assert called(folder) == (3, False)
    inside = sys.modules["made_kernels.callee"].inside.get_overload.__self__  # compiled for kernels
    (code,) = inside.overloads.values()
    assert code.library.get_pointer_to_function(code.fndesc.llvm_func_name) == 0


def test_an_edit_of_a_module_that_is_not_imported_costs_no_compilation(folder: Path):
    (folder / "unrelated.py").write_text("answer = 42\n", encoding="utf-8")
    assert called(folder) == (2, True)


def test_an_edit_of_a_kernel_recompiles_its_callers(folder: Path):
    (folder / "callee.py").write_text(CALLEE.format(2), encoding="utf-8")
    assert called(folder) == (3, False)
    assert called(folder) == (3, True)


def test_a_program_killed_between_index_and_code_leaves_no_old_code(folder: Path):
    """numba writes the index before the code."""
    old = {path: path.read_bytes() for path in kept(folder, "nbc")}
    (folder / "callee.py").write_text(CALLEE.format(2), encoding="utf-8")
    assert called(folder) == (3, False)
    for path, content in old.items():
        path.write_bytes(content)
    assert called(folder) == (3, False)


@pytest.mark.parametrize("year", [1970, 2100])
def test_dates_of_sources_do_not_matter(folder: Path, year: int):
    date = (year - 1970) * 365.2425 * 86400.0
    os.utime(folder / "callee.py", (date, date))
    assert called(folder) == (2, True)


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.999])
def test_truncated_files_are_compiled_again(folder: Path, suffix: str, share: float):
    for path in kept(folder, suffix):
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert called(folder) == (2, False)
    assert called(folder) == (2, True)


def test_code_for_other_types_is_compiled_again(folder: Path):
    """Two programs that compile a kernel for different types at once may choose the same name for its file."""
    before = {*kept(folder, "nbc")}
    assert imported(folder)(1.5) == 2.5
    for of_floats in {*kept(folder, "nbc")} - before:
        (of_integers,) = (each for each in before if each.name.split(".")[:2] == of_floats.name.split(".")[:2])
        of_integers.write_bytes(of_floats.read_bytes())
    assert called(folder) == (2, False)
    assert called(folder) == (2, True)


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_files_with_zeros_are_compiled_again(folder: Path, suffix: str):
    """Some file systems write zeros in a power cut."""
    for path in kept(folder, suffix):
        content = path.read_bytes()
        third = len(content) // 3
        path.write_bytes(content[:third] + bytes(third) + content[2 * third :])
    assert called(folder) == (2, False)
    assert called(folder) == (2, True)


def test_damage_in_a_read_only_folder_costs_a_compilation_each_time(folder: Path, monkeypatch: pytest.MonkeyPatch):
    for path in kept(folder, "nbi"):
        path.write_bytes(b"")

    def refuse(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile._open_for_write", refuse)
    assert called(folder) == (2, False)
    assert called(folder) == (2, False)


def test_machine_code_of_an_installed_package_is_in_the_users_cache_folder(
    tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
):
    """pip does not remove machine code: it would leave a folder of the package without sources."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path / "site-packages")
    installed = shutil.copytree(
        folder, tmp_path / "site-packages" / folder.name, ignore=shutil.ignore_patterns("__pycache__")
    )
    assert called(installed) == (2, False)
    assert called(installed) == (2, True)
    assert not [*installed.rglob("*.nb?")]
    assert [*(tmp_path / "cache/numba").rglob("*.nbc")]


def test_cached_files_are_listed_and_cleared(folder: Path, monkeypatch: pytest.MonkeyPatch):
    cache = folder / "__pycache__"
    monkeypatch.setattr(kernel_cache, "_folders", {cache: None})
    (cache / "caller.outside.nbc.tmp.0123").touch()  # left by a killed program
    (cache / "caller.cpython-311.pyc").touch()
    assert len(kernel_cache.kept_files()[cache]) == 5
    assert kernel_cache.clear_kept() == 5
    assert (cache / "caller.cpython-311.pyc").exists()
    assert {path.suffix for path in cache.iterdir()} == {".pyc"}
    assert called(folder) == (2, False)


def test_processes_that_start_together_compile_each_kernel_once(tmp_path: Path):
    code = (
        "from slamgauge import compile_progress; from slamgauge.ekf.kernels.warm_up import compile_numpy_filters_once;"
        "compile_numpy_filters_once(); print(compile_progress._compiled)"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", code]
    started = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    compiled = sorted(int(process.communicate()[0]) for process in started)
    assert compiled[:2] == [0, 0]
    assert compiled[2] > 5


def test_a_process_does_not_wait_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Another process may hold the lock, for example a stopped one."""
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setattr(kernel_cache, "_folders", {tmp_path: None})
    monkeypatch.setattr(kernel_cache, "PATIENCE", 0.2)
    with (tmp_path / kernel_cache.LOCK).open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with kernel_cache.compiling("kernels", 1):
            pass
