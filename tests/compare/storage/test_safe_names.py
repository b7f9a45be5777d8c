"""Names that hold markup, control characters, bytes that are no UTF-8, or too much."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge.compare.storage.safe_names import LONGEST, file_name, shown

ANY = st.text(st.characters(codec=None))  # lone surrogates among them


@given(ANY)
def test_what_is_shown_can_be_printed_and_written_and_parsed(name: str):
    text = shown(name)
    assert text.isprintable()
    assert shown(text) == text
    element = ElementTree.Element("a", b=text)
    element.text = text
    parsed = ElementTree.fromstring(ElementTree.tostring(element))
    assert (parsed.text or "") == parsed.get("b") == text


@given(ANY)
def test_a_file_name_is_one_in_its_folder(name: str):
    plain = file_name(name)
    assert plain not in {"", ".", ".."}
    assert not {*"/\\\0"} & {*plain}
    assert len(plain.encode()) <= LONGEST


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("q1-long-dense", "q1-long-dense"),
        ("Straße 東 ±σ", "Straße 東 ±σ"),
        ("a\x1b[31m\n", r"a\x1b[31m\n"),
        ("\udcff", r"\udcff"),
        ("\u202egnp", r"\u202egnp"),
    ],
)
def test_only_what_cannot_be_printed_is_written_out(name: str, text: str):
    assert shown(name) == text
    assert file_name(name) == text.replace("\\", "_")
