"""The files of scenarios: shipped ones by name, others by path. No slow library is imported."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean


def shipped() -> dict[str, Traversable]:
    """Return the files of the shipped scenarios by name."""
    folder = resources.files(__package__ or "")
    return {file.name.removesuffix(".toml"): file for file in folder.iterdir() if file.name.endswith(".toml")}


def locate(where: str) -> Traversable:
    """Return the file of a shipped name or path; a shipped name wins.

    Raises:
        UserError: no scenario has that name or path.
    """
    known, path = shipped(), Path(where)
    if where in known:
        return known[where]
    if path.suffix == ".toml" or path.is_file():
        return path
    remedy = did_you_mean(where, known, f"use {', '.join(sorted(known))}, or a TOML file", most=3)
    raise UserError(f"{where}: no such scenario; {remedy}")
