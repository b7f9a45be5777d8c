"""The manual opened from disk, tested on a small site with the same settings."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .conftest import Reader

pytestmark = pytest.mark.slow

CONF = Path(__file__).parents[3] / "docs/conf.py"
FOUND = """
const done = arguments[arguments.length - 1];
const look = () => { const found = [...document.querySelectorAll('#search-results li a')];
  if (found.length) setTimeout(() => done(found.map((each) => each.textContent)), 300); else setTimeout(look, 20); };
look();"""


def test_the_search_works_from_disk_without_console_errors(reader: Reader, tmp_path: Path):
    source, site = tmp_path / "docs", tmp_path / "site"
    source.mkdir()
    (source / "conf.py").write_bytes(CONF.read_bytes())
    shutil.copytree(CONF.parent / "static", source / "static")
    (source / "index.md").write_text("# Start\n\n```{toctree}\nother\n```\n")
    (source / "other.md").write_text("# A page of figures\n\nOf the hindsight optimum.\n")
    made = [sys.executable, "-m", "sphinx", "-q", "-W", str(source), str(site)]
    subprocess.run(made, check=True, capture_output=True)
    reader.complaints()
    reader.driver.get(f"{(site / 'search.html').as_uri()}?q=hindsight")
    assert reader.wait(FOUND) == ["A page of figures"]
    assert reader.complaints() == []
