"""Tables of TOML files: what is written is read again, and overrides go where their keys say."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamgauge.compare.storage.toml_tables import override, read_toml, write_toml
from slamgauge.errors import UserError


def test_what_is_written_is_read_again(tmp_path: Path):
    sections = {
        "one": {"text": 'a "quoted" \\ é\n', "number": 1e-9, "whole": 3, "list": [1.0, -2.5, 3.0], "none": None},
        "two": {"table": {"a b": "c", "d": 4}, "empty": {}},
    }
    write_toml(tmp_path / "file.toml", sections)
    del sections["one"]["none"]
    assert read_toml(tmp_path / "file.toml") == sections


def test_overrides_make_their_sections():
    table = {"a": {"b": 1}, "c": 2}
    for text in ("a.b=3", "a.d = [1, 2]", "c.e=words of one's own", "f=true"):
        override(table, text)
    assert table == {"a": {"b": 3, "d": [1, 2]}, "c": {"e": "words of one's own"}, "f": True}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a = \n", "not valid TOML: .*line 1"),
        (b"a = '\xff'", "not a UTF-8 text"),
        (b"a = " + b"[" * 3000 + b"]" * 3000, "not valid TOML: too many nested brackets for Python"),
        (b"a = " + b"{a=" * 3000 + b"1" + b"}" * 3000, "not valid TOML: too many nested brackets"),
        (b"a = " + b"1" * 5000, "not valid TOML: a number has too many digits for Python; correct that line"),
    ],
)
def test_files_that_are_no_toml(tmp_path: Path, content: bytes, message: str):
    (tmp_path / "file.toml").write_bytes(content)
    with pytest.raises(UserError, match=message):
        read_toml(tmp_path / "file.toml")


@pytest.mark.parametrize("value", ["[" * 3000 + "]" * 3000, "1" * 5000])
def test_values_that_are_no_toml_for_python_are_bare_words(value: str):
    table: dict[str, object] = {}
    override(table, f"a={value}")
    assert table == {"a": value}


def test_what_is_no_override_is_told_in_short():
    with pytest.raises(UserError, match=r"^=1{99}: not an override; write dotted.key=value$"):
        override({}, "=" + "1" * 5000)
