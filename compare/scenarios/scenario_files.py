"""The files of scenarios: shipped ones by name, others by path. No slow library is imported."""

from __future__ import annotations

from pathlib import Path

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean


def shipped() -> dict[str, Path]:
    """Return the files of the shipped scenarios by name."""
    return {path.stem: path for path in Path(__file__).parent.glob("*.toml")}


def locate(where: str) -> Path:
    """Return the file of a shipped name or path; a shipped name wins, and an unknown one is refused."""
    known, path = shipped(), Path(where)
    if where in known:
        return known[where]
    if path.suffix == ".toml" or path.is_file():
        return path
    remedy = did_you_mean(where, known, f"use {', '.join(sorted(known))}, or a TOML file", most=3)
    raise UserError(f"{where}: no such scenario; {remedy}")
