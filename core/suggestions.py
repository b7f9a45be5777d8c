"""Near names, for the remedies of error texts."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def near_names(name: str, known: Iterable[str], most: int = 1) -> list[str]:
    """Return the known names that are similar to `name`, nearest first."""
    return get_close_matches(name, list(known), n=most)


def did_you_mean(name: str, known: Iterable[str], otherwise: str = "", most: int = 1) -> str:
    """Return a remedy: `did you mean NEAR?`, or without a near name `otherwise`, by default the list of all."""
    known = list(known)
    near = near_names(name, known, most)
    return f"did you mean {' or '.join(near)}?" if near else otherwise or f"use {', '.join(known)}"
