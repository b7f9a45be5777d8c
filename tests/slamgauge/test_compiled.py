"""Machine code that is kept: none outlives its sources. That it is kept: `tests/ekf/kernels/test_compilation.py`."""

from __future__ import annotations

import os
import re
from pathlib import Path

from slamgauge import compiled

ROOT = Path(__file__).parents[2]


def test_machine_code_older_than_any_source_is_dropped(tmp_path: Path) -> None:
    cache, rules = tmp_path / "__pycache__", Path(compiled.__file__).stat().st_mtime
    cache.mkdir()
    for name, time in (("models.py", 200.0), ("corrections.py", 100.0)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (rules + time, rules + time))
    for name, time in (("corrections.old.nbi", 150.0), ("corrections.new.nbi", 250.0)):
        (cache / name).touch()
        os.utime(cache / name, (rules + time, rules + time))
    compiled.drop_outdated(tmp_path)
    assert [path.name for path in cache.iterdir()] == ["corrections.new.nbi"]


def test_machine_code_older_than_the_rules_of_compilation_is_dropped(tmp_path: Path) -> None:
    index, before = tmp_path / "__pycache__" / "models.old.nbi", Path(compiled.__file__).stat().st_mtime - 1.0
    index.parent.mkdir()
    index.touch()
    os.utime(index, (before, before))
    compiled.drop_outdated(tmp_path)
    assert not index.exists()


def test_every_folder_with_kernels_is_looked_after() -> None:
    """A kernel elsewhere would outlive its edits."""
    with_kernels = {
        path.parent.relative_to(ROOT).as_posix()
        for floor in ("slamgauge", "ekf", "graph_baseline", "compare")
        for path in (ROOT / floor).rglob("*.py")
        if re.search(r"^@(kernel|inner)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert with_kernels == {"ekf/kernels", "graph_baseline"}
    for folder in with_kernels:
        assert "\ndrop_outdated(" in (ROOT / folder / "__init__.py").read_text(encoding="utf-8")
