"""Roles of parameters and attributes by the words in their names: `n_landmarks`, `numLandmarks`, `LANDMARK_COUNT`."""

from __future__ import annotations

import re
from collections.abc import Mapping

Roles = Mapping[str, tuple[str, str]]  # role -> its key words and further words
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


def words_of(name: str) -> set[str]:
    """Return the words of a name, in small letters unless they are one letter; `delta_x` and `d_x` are `dx`."""
    return {each if len(each) == 1 else each.lower() for each in WORD.findall(re.sub(r"\b(delta|d)_", "d", name))}


def role_of(name: str, roles: Roles) -> str | None:
    """Return the first role that knows all words of a name, one of them as a key word; None without one."""
    words = words_of(name)
    for role, (keys, further) in roles.items():
        if words & {*keys.split()} and words <= {*keys.split(), *further.split()}:
            return role
    return None
