"""Names with markup, control characters, invalid UTF-8, or too many characters."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgauge.compare.storage.safe_names import LONGEST, file_name, shown

ANY = st.text(st.characters(codec=None))  # includes lone surrogates


@given(ANY)
def test_shown_names_are_printable_and_valid_in_xml(name: str):
    text = shown(name)
    assert text.isprintable()
    assert shown(text) == text
    element = ElementTree.Element("a", b=text)
    element.text = text
    parsed = ElementTree.fromstring(ElementTree.tostring(element))
    assert (parsed.text or "") == parsed.get("b") == text


@given(ANY)
def test_file_names_are_valid_and_stay_in_their_folder(name: str):
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
def test_only_unprintable_characters_are_replaced(name: str, text: str):
    assert shown(name) == text
    assert file_name(name) == text.replace("\\", "_")
