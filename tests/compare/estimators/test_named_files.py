"""Data files that belong to the sources of user code."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.estimators.sources import named_files

pytestmark = pytest.mark.slow


def test_only_files_opened_for_writing_are_no_data(tmp_path: Path):
    for name in ("read.txt", "joined.txt", "log.txt"):
        (tmp_path / name).touch()
    code = b"open('read.txt', encoding='ascii'); open(Path('.', 'joined.txt')); open('log.txt', mode='a')"
    assert {each.name for each in named_files(tmp_path, code)} == {"read.txt", "joined.txt"}
