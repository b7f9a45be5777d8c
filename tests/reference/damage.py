"""Random damage of text files."""

from __future__ import annotations

import numpy as np

WORDS = (
    *("nan", "inf", "-inf", "1e400", "1e49", "-1e49", "1e-320", "", "-1", "0", "9007199254740993", "1" * 5000, "0x10"),
    *("word", '"', ",", ";", "#", "\t", "é", "\u2028", "1_0", "=", "[", "]", "\x1a", "VERTEX_SE2", "-0.0", "1e15"),
    *("1e20", "1" + "0" * 20, "1e-9", "[" * 3000, "true", "0.5", "3", "1e308", "\x00", "18446744073709551616"),
)


def changed_text(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a word, a line or a byte, up to three times."""
    for _ in range(rng.integers(1, 4)):
        content = _changed_once(content, rng) or b"\n"
    return content


def _changed_once(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    at = int(rng.integers(len(lines)))
    match int(rng.integers(8)):
        case 0:
            return content[: rng.integers(len(content))]
        case 1:
            lines[at] = lines[int(rng.integers(len(lines)))]
        case 2:
            del lines[at]
        case 3:
            lines = [lines[int(each)] for each in rng.permutation(len(lines))]
        case 4:
            return b"".join([content[:at], bytes([int(rng.integers(256))]), content[at + int(rng.integers(2)) :]])
        case _:
            separator = next((each for each in (b",", b" = ") if each in lines[at]), b" ")
            words = lines[at].split(separator)
            words[int(rng.integers(len(words)))] = str(rng.choice(WORDS)).encode()
            lines[at] = separator.join(words)
    return b"\n".join(lines)
