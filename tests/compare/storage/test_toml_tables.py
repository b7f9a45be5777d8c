"""TOML files: round trip, overrides, and errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.storage.toml_tables import override, read_toml, write_toml
from slamgauge.errors import UserError


def test_round_trip(tmp_path: Path):
    sections = {
        "one": {"text": 'a "quoted" \\ é\n', "number": 1e-9, "whole": 3, "list": [1.0, -2.5, 3.0], "none": None},
        "two": {"table": {"a b": "c", "d": 4}, "empty": {}},
    }
    write_toml(tmp_path / "file.toml", sections)
    del sections["one"]["none"]
    assert read_toml(tmp_path / "file.toml") == sections


def test_overrides_create_missing_sections():
    table = {"a": {"b": 1}, "c": 2}
    for text in ("a.b=3", "a.d = [1, 2]", "c.e=a bare text", "f=true", f"g={'1' * 5000}"):
        override(table, text)
    assert table == {"a": {"b": 3, "d": [1, 2]}, "c": {"e": "a bare text"}, "f": True, "g": "1" * 5000}
    with pytest.raises(UserError, match=r"^=1{99}: not an override; write dotted.key=value$"):
        override({}, "=" + "1" * 5000)


@pytest.mark.parametrize(
    ("content", "message"), [(b"a = \n", "not valid TOML: .*line 1"), (b"a = '\xff'", "line 1: not a text in UTF-8")]
)
def test_invalid_files_are_an_error(tmp_path: Path, content: bytes, message: str):
    (tmp_path / "file.toml").write_bytes(content)
    with pytest.raises(UserError, match=message):
        read_toml(tmp_path / "file.toml")
