"""Scenarios: what a simulated run consists of, read from TOML files.

A file may begin with `extends = "a shipped name"`: its own keys then come on top of that scenario's.
The schema stands in `schema`. Every mistake of a file is reported, each in a line that names
the file and the key.
"""

from __future__ import annotations

import reprlib
import tomllib
from collections.abc import Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from slamgauge.compare.scenarios.csv_tables import FOLDER
from slamgauge.compare.scenarios.landmarks import Landmarks, RandomLandmarks
from slamgauge.compare.scenarios.odometry_errors import Motion
from slamgauge.compare.scenarios.schema import (
    Association,
    Assumed,
    Delayed,
    Fis,
    InverseDepth,
    Prior,
    Scenario,
    Update,
)
from slamgauge.compare.scenarios.sensor_errors import Sensor
from slamgauge.compare.scenarios.trajectory import KINDS, Segment, kind_of
from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.storage.toml_tables import Table, parse_toml
from slamgauge.compare.storage.toml_tables import override as set_key
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean, near_names

__all__ = ["Scenario", "ScenarioError", "load_scenario", "shipped_scenarios"]

Place = tuple[str | int, ...]

LONGEST_KEY = 100  # characters of an unknown one, or of the name of a scenario, that are told
FORMS = {"kind", "segments", "random"}  # keys that give a section another form: it then replaces the extended one whole


class ScenarioError(UserError):
    """The mistakes of a scenario, one located line each."""


def shipped_scenarios() -> list[tuple[str, str]]:
    """Name and description of every scenario that comes with slamgauge, by name."""
    return [(name, load_scenario(name).description) for name in sorted(_shipped())]


def load_scenario(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """The scenario of a shipped name or a TOML file, with `dotted.key=value` overrides.

    Args:
        name_or_path: A shipped name, or the path of a TOML file; a shipped name wins. The files that a scenario names
            are looked for in the folder of the TOML file, overrides included.
        overrides: Each value is read as TOML, or as a bare string where it is not valid TOML.

    Raises:
        ScenarioError: With one line `where: key: what; remedy` for each mistake.
    """
    where = str(name_or_path)
    source = _locate(where)
    table = _extended(_parse(source, where), where)
    try:
        for override in overrides:
            set_key(table, override)
    except UserError as error:
        raise ScenarioError(str(error)) from None
    mistakes = ["name: unknown key; the file's own name is the scenario's name"] if "name" in table else []
    try:
        files = {FOLDER: Path(where).parent if source == Path(where) else Path()}
        scenario = Scenario.model_validate({**table, "name": shown(Path(source.name).stem)}, context=files)
    except ValidationError as error:
        mistakes += _mistakes(error, table)
    else:
        if not mistakes:
            return scenario
    raise ScenarioError("\n".join(f"{where}: {mistake}" for mistake in mistakes))


def as_scenario(scenario: Scenario | str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """The scenario itself, or that of a name or a path with these overrides."""
    return scenario if isinstance(scenario, Scenario) else load_scenario(scenario, overrides)


def sampled(scenario: Scenario | str | Path) -> Scenario:
    """Likewise, with the true start of a named one drawn from the prior, as statistics need it."""
    return as_scenario(scenario, ["start=sampled"])


def _shipped() -> dict[str, Traversable]:
    folder = resources.files(__package__ or "")
    return {file.name.removesuffix(".toml"): file for file in folder.iterdir() if file.name.endswith(".toml")}


def _locate(where: str) -> Traversable:
    shipped, path = _shipped(), Path(where)
    if where in shipped:
        return shipped[where]
    if path.suffix == ".toml" or path.is_file():
        return path
    remedy = did_you_mean(where, shipped, f"use {', '.join(sorted(shipped))}, or a TOML file", most=3)
    raise ScenarioError(f"{where}: no such scenario; {remedy}")


def _parse(source: Traversable, where: str) -> Table:
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{where}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{where}: not a text in UTF-8; save it as such") from None
    try:
        return parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error).replace("at end of document", f"at line {len(text.splitlines())}, the end")
        raise ScenarioError(f"{where}: not valid TOML: {message}; correct that line") from None


def _extended(table: Table, where: str) -> Table:
    """The table on top of the shipped scenario that its key `extends` names, key by key."""
    if "extends" not in table:
        return table
    name, shipped = table.pop("extends"), _shipped()
    if not isinstance(name, str) or name not in shipped:
        given = str(name)[:LONGEST_KEY]
        remedy = did_you_mean(given, sorted(shipped))
        raise ScenarioError(f"{where}: extends: {given!r} is no shipped scenario; {remedy}")
    base = _extended(_parse(shipped[name], name), name)
    for key, value in table.items():
        merged = isinstance(value, dict) and isinstance(base.get(key), dict) and not FORMS & value.keys()
        base[key] = {**base[key], **value} if merged else value
    return base


# --- mistakes ----------------------------------------------------------------------------------

_KEYS: dict[Place, tuple[str, ...]] = {
    (): ("extends", *(key for key in Scenario.model_fields if key != "name")),
    ("prior",): tuple(Prior.model_fields),
    ("trajectory",): tuple({key: None for each in (*KINDS.values(), Segment) for key in each.model_fields}),
    ("trajectory", "segments"): tuple(Segment.model_fields),
    ("motion",): tuple(Motion.model_fields),
    ("sensor",): tuple(Sensor.model_fields),
    ("assumed",): tuple(Assumed.model_fields),
    ("association",): tuple(Association.model_fields),
    ("update",): tuple(Update.model_fields),
    ("fis",): tuple(Fis.model_fields),
    ("inverse_depth",): tuple(InverseDepth.model_fields),
    ("delayed",): tuple(Delayed.model_fields),
    ("landmarks",): tuple(Landmarks.model_fields),
    ("landmarks", "random"): tuple(RandomLandmarks.model_fields),
}


def _mistakes(error: ValidationError, table: Table) -> list[str]:
    """One `key: what; remedy` for each mistake; a misspelt key is not reported as missing as well."""
    details = [(_place(detail["loc"], table), detail) for detail in error.errors()]
    unknown = [place for place, detail in details if detail["type"] == "extra_forbidden"]
    meant = {(*place[:-1], near) for place in unknown for near in near_names(str(place[-1]), _keys(place))}
    kind = str(kind_of(table.get("trajectory")))
    told = [each for each in details if each[1]["type"] != "missing" or each[0] not in meant]
    lines = [_line(place, detail, kind) for place, detail in told]
    return list(dict.fromkeys(lines))


def _place(loc: Place, table: Table) -> Place:
    """The place in the user's own file, where a single segment's keys may stand in [trajectory]."""
    if loc[:1] == ("trajectory",) and len(loc) > 1:  # what follows is the kind
        loc = ("trajectory", *loc[2:])
    single = loc[:3] == ("trajectory", "segments", 0) and "segments" not in table["trajectory"]
    return ("trajectory", *loc[3:]) if single else loc


def _keys(place: Place) -> tuple[str, ...]:
    return _KEYS[tuple(part for part in place[:-1] if isinstance(part, str))]


def _line(place: Place, detail: ErrorDetails, kind: str) -> str:
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")
    if detail["type"] == "extra_forbidden":
        if place[-1] in _keys(place):  # only the kinds and forms of a trajectory share a table
            if kind == "segments" and place[-1] in Segment.model_fields:
                return "trajectory: has both forms; give segments, or speed, yaw_rate and duration"
            return f"{where}: a trajectory of the kind {kind} has none; remove it or change kind"
        return f"{where[:LONGEST_KEY]}: unknown key; {did_you_mean(str(place[-1]), _keys(place))}"
    what = detail["msg"].replace("Field required", "missing; add it").replace("Tuple should", "must")
    what = what.replace(" after validation", "").replace("valid tuple", "list")
    if what.startswith("Input should be"):
        kind = "a table" if detail["type"] == "model_type" else what.removeprefix("Input should be ")
        what = f"must be {kind}, not {reprlib.repr(detail['input'])}"
    return f"{where}: {what}" if where else what  # what concerns several sections names its keys itself
