"""Read scenarios from TOML files and report every mistake in a line with file and key.

A file may begin with `extends = "a shipped name"`: its keys then override those of that scenario. `schema` has the
sections and keys.
"""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from slamgauge.compare.scenarios.scenario_files import locate, shipped
from slamgauge.compare.scenarios.schema import Association, RandomLandmarks, Scenario
from slamgauge.compare.scenarios.section import FOLDER
from slamgauge.compare.scenarios.trajectory import KINDS, Segment, kind_of
from slamgauge.compare.storage.files import Table, read_toml, toml_text
from slamgauge.compare.storage.files import override as set_key
from slamgauge.compare.storage.result_files import shown
from slamgauge.ekf.settings import Method
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean, near_names

Place = tuple[str | int, ...]

LONGEST_KEY = 100  # characters of an unknown key or scenario name that a message quotes
# an override of one of these keys removes the other
ALTERNATIVES = {"landmarks.random": "positions", "landmarks.positions": "random"}
FORMS = {"kind", "segments", "random"}  # keys that change the form of a section: it then replaces the extended section


def shipped_scenarios() -> list[tuple[str, str]]:
    """Return name and description of every shipped scenario, sorted by name."""
    return [(name, load_scenario(name).description) for name in sorted(shipped())]


def load_scenario(name_or_path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Read a shipped scenario or a TOML file, with `dotted.key=value` overrides.

    Args:
        name_or_path: a shipped name, or the path of a TOML file; a shipped name wins. Files that a scenario or an
            override names are relative to the folder of the TOML file.
        overrides: each value is read as TOML, or as a string if it is not valid TOML.

    Raises:
        UserError: with one line `where: key: what; remedy` for each mistake.
    """
    where = str(name_or_path)
    source = locate(where)
    table = _extended(read_toml(source), where)
    for override in overrides:
        other = ALTERNATIVES.get(override.partition("=")[0].strip())
        if other is not None and isinstance(table.get("landmarks"), dict):
            table["landmarks"].pop(other, None)
        set_key(table, override)
    if "name" in table:
        raise UserError(f"{where}: name: unknown key; the file's own name is the scenario's name")
    files = {FOLDER: Path(where).parent if source == Path(where) else Path()}
    try:
        return Scenario.model_validate({**table, "name": shown(Path(source.name).stem)}, context=files)
    except ValidationError as error:
        raise UserError("\n".join(f"{where}: {mistake}" for mistake in _mistakes(error, table))) from None


class _UnknownAssociation(Association):
    method: Method = "nearest-neighbour"


def stored_association(overrides: Sequence[str]) -> Association:
    """Return how filters associate a stored recording without ids, from overrides of [association].

    Raises:
        UserError: with one line for each mistake.
    """
    table: Table = {}
    for override in overrides:
        set_key(table, override)
    others = [key[:LONGEST_KEY] for key in table if key != "association"]
    if others:
        raise UserError(f"set: {others[0]}: not a setting of stored recordings; give association.method=jcbb")
    try:
        return _UnknownAssociation.model_validate(table.get("association", {}))
    except ValidationError as error:
        lines = (f"set: {mistake}" for mistake in _mistakes(error, table, ("association",)))
        raise UserError("\n".join(lines)) from None


def as_scenario(scenario: Scenario | str | Path) -> Scenario:
    """Return a scenario unchanged, or load a name or path."""
    return scenario if isinstance(scenario, Scenario) else load_scenario(scenario)


def scenario_text(scenario: Scenario) -> str:
    """Return the text of a TOML file that makes this scenario: all keys that were set, CSV files by their names."""
    keys = scenario.model_dump(exclude_unset=True, exclude={"name"})
    for section, key in (("trajectory", "file"), ("motion", "covariances"), ("sensor", "sightings")):
        if isinstance(keys[section].get(key), dict):
            keys[section][key] = keys[section][key]["name"]
    top = {name: value for name, value in keys.items() if not isinstance(value, dict)}
    return toml_text({"": top, **{name: value for name, value in keys.items() if isinstance(value, dict)}})


def _extended(table: Table, where: str) -> Table:
    """Apply a table key by key to the shipped scenario that its key `extends` names."""
    if "extends" not in table:
        return table
    name, known = table.pop("extends"), shipped()
    if not isinstance(name, str) or name not in known:
        given = str(name)[:LONGEST_KEY]
        remedy = did_you_mean(given, sorted(known))
        raise UserError(f"{where}: extends: {given!r} is not a shipped scenario; {remedy}")
    base = _extended(read_toml(known[name]), name)
    for key, value in table.items():
        merged = isinstance(value, dict) and isinstance(base.get(key), dict) and not FORMS & value.keys()
        base[key] = {**base[key], **value} if merged else value
    return base


_KEYS: dict[Place, tuple[str, ...]] = {  # known keys of the sections that have several forms or inner ones
    (): ("extends", *(key for key in Scenario.model_fields if key != "name")),
    ("trajectory",): tuple({key: None for each in (*KINDS.values(), Segment) for key in each.model_fields}),
    ("trajectory", "segments"): tuple(Segment.model_fields),
    ("landmarks", "random"): tuple(RandomLandmarks.model_fields),
}


def _keys(place: Place) -> tuple[str, ...]:
    """Return the known keys of the section of a key."""
    section = tuple(part for part in place[:-1] if isinstance(part, str))
    if section in _KEYS:
        return _KEYS[section]
    model: Any = Scenario.model_fields[section[0]].annotation
    return tuple(model.model_fields)


def _mistakes(error: ValidationError, table: Table, section: Place = ()) -> list[str]:
    """Return a line `key: what; remedy` for each mistake; a misspelt key is not also reported as missing."""
    details = [(_place((*section, *detail["loc"]), table), detail) for detail in error.errors()]
    unknown = [place for place, detail in details if detail["type"] == "extra_forbidden"]
    meant = {(*place[:-1], near) for place in unknown for near in near_names(str(place[-1]), _keys(place))}
    kind = str(kind_of(table.get("trajectory")))
    reported = [each for each in details if each[1]["type"] != "missing" or each[0] not in meant]
    return list(dict.fromkeys(_line(place, detail, kind) for place, detail in reported))


def _place(loc: Place, table: Table) -> Place:
    """Return the place in the user's file, where the keys of a single segment may be in [trajectory]."""
    if loc[:1] == ("trajectory",) and len(loc) > 1:  # pydantic inserts the kind
        loc = ("trajectory", *loc[2:])
    single = loc[:3] == ("trajectory", "segments", 0) and "segments" not in table["trajectory"]
    return ("trajectory", *loc[3:]) if single else loc


def _line(place: Place, detail: ErrorDetails, kind: str) -> str:
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")
    if detail["type"] == "extra_forbidden":
        if place[-1] not in _keys(place):
            return f"{where[:LONGEST_KEY]}: unknown key; {did_you_mean(str(place[-1]), _keys(place))}"
        if kind == "segments" and place[-1] in Segment.model_fields:  # only the forms of a trajectory share a table
            return "trajectory: has both forms; give segments, or speed, yaw_rate and duration"
        return f"{where}: a trajectory of the kind {kind} has none; remove it or change kind"
    values, what = detail.get("ctx", {}), f"{detail['msg'][0].lower()}{detail['msg'][1:]}"
    if "message" in values:  # the text of our own validators (`section.invalid`)
        where, what = f"{where}.{values.get('key', '')}".strip("."), values["message"]
    elif "error" in values:  # a `UserError`
        what = str(values["error"])
    elif detail["type"] == "missing":
        what = "missing; add it"
    elif "actual_length" not in values:
        what = f"{what}, not {reprlib.repr(detail['input'])}"
    return f"{where}: {what}" if where else what  # a mistake of several sections names its keys in the message
