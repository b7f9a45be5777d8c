"""Names of others (scenarios, files, folders, labels) as they may stand in what we write and show.

What a name holds is anybody's: characters that terminals obey and XML cannot hold, bytes that are no UTF-8, markup,
more characters than a file system takes. Every text of theirs passes one of these on its way out.
"""

from __future__ import annotations

LONGEST = 200  # bytes of a file name; most file systems take 255, and endings of ours follow


def shown(name: str) -> str:
    r"""For terminals, figures, JSON and XML: what cannot be printed is written out, as \x1b or \udcff."""
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in name)


def math_text(text: str) -> str:
    r"""For texts in which matplotlib looks for formulas: those that it wraps; in others it does not (`plot_style`)."""
    return text.replace("$", r"\$")


def file_name(name: str) -> str:
    """For file systems: no folder, nothing that cannot be printed, and not too long."""
    plain = shown(name).replace("/", "_").replace("\\", "_").encode()[:LONGEST].decode(errors="ignore")
    return f"_{plain}" if plain in {"", ".", ".."} else plain
