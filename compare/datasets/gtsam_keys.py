"""Ids of graphs that GTSAM wrote: a key has the letter of its symbol in the highest of eight bytes, as in x12 or l3."""

from __future__ import annotations

from collections.abc import Sequence

from slamgauge.compare.storage.text_lines import Line

BITS = 56  # bits of the number behind the letter
PLAIN = "\0"  # letter of a key that is a number only
Place = tuple[Line, int]  # a word of a line that is an id


def renumber(places: Sequence[Place]) -> tuple[str, ...]:
    """Replace the keys of symbols by small ids, in place; return a note about them.

    The first letter, that of the poses, keeps its numbers. The numbers of other letters follow after a power of ten:
    with 300 poses, landmark l7 has the id 1007. Graphs without letters are unchanged.

    Args:
        places: Where the ids are; those of poses come first.
    """
    keys = {word: int(word) for line, at in places if (word := line.words[at]).isdecimal() and len(word) < 20}
    symbols = {word: (chr(key >> BITS), key & ((1 << BITS) - 1)) for word, key in keys.items()}
    letters = list(dict.fromkeys(letter for letter, _ in symbols.values()))
    if letters in ([], [PLAIN]) or not all(letter == PLAIN or letter.isalpha() for letter in letters):
        return ()
    apart = 10 ** len(str(max(number for _, number in symbols.values())))
    for line, at in places:
        if line.words[at] in symbols:
            letter, number = symbols[line.words[at]]
            line.words[at] = str(letters.index(letter) * apart + number)
    named = (f"{letter}1 has the id {apart * at + 1}" for at, letter in enumerate(letters) if letter != PLAIN)
    return (f"ids are keys of GTSAM and are renumbered: {', '.join(named)}",)
