"""Make user-given names (scenarios, files, folders, labels) safe for output.

Such a name can contain control characters, bytes that are not valid UTF-8 or markup, and it can be too long for a file
name. Every name passes one of these functions before it is printed or written.
"""

from __future__ import annotations

LONGEST = 200  # bytes of a file name; most file systems allow 255, and extensions follow


def shown(name: str) -> str:
    r"""Return the name with escapes (\x1b, \udcff) for characters that cannot be printed."""
    if name.isprintable():
        return name
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in name)


def file_name(name: str) -> str:
    """Return a valid file name: printable, short, and without folders."""
    plain = shown(name).replace("/", "_").replace("\\", "_").encode()[:LONGEST].decode(errors="ignore")
    return f"_{plain}" if plain in {"", ".", ".."} else plain
