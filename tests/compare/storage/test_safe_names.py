"""Names with markup, control characters, invalid UTF-8, or too many characters."""

from __future__ import annotations

from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st

from slamgauge.compare.storage.result_files import LONGEST, file_name, shown


@given(st.text(st.characters(codec=None)))  # includes lone surrogates
def test_names_are_printable_valid_in_xml_and_stay_in_their_folder(name: str):
    text, plain = shown(name), file_name(name)
    assert text.isprintable()
    assert shown(text) == text
    parsed = ElementTree.fromstring(ElementTree.tostring(ElementTree.Element("a", b=text)))
    assert parsed.get("b") == text
    assert plain not in {"", ".", ".."}
    assert not {*"/\\\0"} & {*plain}
    assert len(plain.encode()) <= LONGEST


def test_only_unprintable_characters_are_replaced():
    names = {"Straße 東 ±σ": "Straße 東 ±σ", "a\x1b[31m\n": r"a\x1b[31m\n", "\udcff\u202eg": r"\udcff\u202eg"}
    for name, text in names.items():
        assert (shown(name), file_name(name)) == (text, text.replace("\\", "_"))
