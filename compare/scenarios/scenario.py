"""Read scenarios from TOML files and report every mistake in a line with file and key.

A file may begin with `extends = "a shipped name"`: its keys then override those of that scenario. `schema` has the
sections and keys.
"""

from __future__ import annotations

import reprlib
import tomllib
from collections.abc import Sequence
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from slamgauge.compare.scenarios.csv_tables import FOLDER, TableText
from slamgauge.compare.scenarios.landmarks import Landmarks, RandomLandmarks
from slamgauge.compare.scenarios.scenario_files import ScenarioError, locate, shipped
from slamgauge.compare.scenarios.schema import Association, Scenario
from slamgauge.compare.scenarios.section import Section
from slamgauge.compare.scenarios.trajectory import KINDS, Segment, kind_of
from slamgauge.compare.storage.safe_names import shown
from slamgauge.compare.storage.toml_tables import Table, toml_text
from slamgauge.compare.storage.toml_tables import override as set_key
from slamgauge.ekf.settings import Method
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean, near_names

__all__ = ["Scenario", "ScenarioError", "load_scenario", "shipped_scenarios"]

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
        ScenarioError: with one line `where: key: what; remedy` for each mistake.
    """
    where = str(name_or_path)
    source = locate(where)
    table = _extended(_parse(source, where), where)
    try:
        for override in overrides:
            other = ALTERNATIVES.get(override.partition("=")[0].strip())
            if other is not None and isinstance(table.get("landmarks"), dict):
                table["landmarks"].pop(other, None)
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


class _UnknownAssociation(Association):
    method: Method = "nearest-neighbour"


class _StoredSettings(Section):
    """Settings of a stored recording, one section: error messages name its keys as `association.gate`."""

    association: _UnknownAssociation = _UnknownAssociation()


def stored_association(overrides: Sequence[str]) -> Association:
    """Return how filters associate a stored recording without ids, from overrides of [association].

    Raises:
        ScenarioError: with one line for each mistake.
    """
    table: Table = {}
    for override in overrides:
        set_key(table, override)
    others = [key[:LONGEST_KEY] for key in table if key != "association"]
    if others:
        raise ScenarioError(f"set: {others[0]}: not a setting of stored recordings; give association.method=jcbb")
    try:
        return _StoredSettings.model_validate(table).association
    except ValidationError as error:
        raise ScenarioError("\n".join(f"set: {mistake}" for mistake in _mistakes(error, table))) from None


def as_scenario(scenario: Scenario | str | Path) -> Scenario:
    """Return a scenario unchanged, or load a name or path."""
    return scenario if isinstance(scenario, Scenario) else load_scenario(scenario)


def scenario_text(scenario: Scenario) -> str:
    """Return the text of a TOML file that makes this scenario: all keys that were set, CSV files by their names."""
    given = scenario.model_fields_set - {"name"}
    keys = {name: _plain(getattr(scenario, name)) for name in Scenario.model_fields if name in given}
    top = {name: value for name, value in keys.items() if not isinstance(value, dict)}
    return toml_text({"": top, **{name: value for name, value in keys.items() if isinstance(value, dict)}})


def _plain(value: object) -> Any:
    """Return a section as a table of the keys that were set, and any other value unchanged."""
    if isinstance(value, TableText):
        return value.name
    if isinstance(value, Section):
        names = [name for name in type(value).model_fields if name in value.model_fields_set]
        return {name: _plain(getattr(value, name)) for name in names}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def _parse(source: Traversable, where: str) -> Table:
    try:
        content = source.read_bytes()
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise ScenarioError(f"{where}: cannot be read ({error.strerror}); check the path") from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{where}: not a UTF-8 text; save it as UTF-8") from None
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = str(error).replace("at end of document", f"at line {len(text.splitlines())}, the end")
        raise ScenarioError(f"{where}: not valid TOML: {message}; correct that line") from None


def _extended(table: Table, where: str) -> Table:
    """Apply a table key by key to the shipped scenario that its key `extends` names."""
    if "extends" not in table:
        return table
    name, known = table.pop("extends"), shipped()
    if not isinstance(name, str) or name not in known:
        given = str(name)[:LONGEST_KEY]
        remedy = did_you_mean(given, sorted(known))
        raise ScenarioError(f"{where}: extends: {given!r} is not a shipped scenario; {remedy}")
    base = _extended(_parse(known[name], name), name)
    for key, value in table.items():
        merged = isinstance(value, dict) and isinstance(base.get(key), dict) and not FORMS & value.keys()
        base[key] = {**base[key], **value} if merged else value
    return base


# --- mistakes ----------------------------------------------------------------------------------

_KEYS: dict[Place, tuple[str, ...]] = {
    (): ("extends", *(key for key in Scenario.model_fields if key != "name")),
    ("trajectory",): tuple({key: None for each in (*KINDS.values(), Segment) for key in each.model_fields}),
    ("trajectory", "segments"): tuple(Segment.model_fields),
    ("landmarks",): tuple(Landmarks.model_fields),
    ("landmarks", "random"): tuple(RandomLandmarks.model_fields),
}


def _mistakes(error: ValidationError, table: Table) -> list[str]:
    """Return a line `key: what; remedy` for each mistake; a misspelt key is not also reported as missing."""
    details = [(_place(detail["loc"], table), detail) for detail in error.errors()]
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


def _keys(place: Place) -> tuple[str, ...]:
    """Return the known keys of the section of a key."""
    section = tuple(part for part in place[:-1] if isinstance(part, str))
    if section not in _KEYS:
        model: Any = Scenario.model_fields[str(section[0])].annotation
        return tuple(model.model_fields)
    return _KEYS[section]


def _line(place: Place, detail: ErrorDetails, kind: str) -> str:
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).removeprefix(".")
    if detail["type"] == "extra_forbidden":
        if place[-1] in _keys(place):  # only the kinds and forms of a trajectory share a table
            if kind == "segments" and place[-1] in Segment.model_fields:
                return "trajectory: has both forms; give segments, or speed, yaw_rate and duration"
            return f"{where}: a trajectory of the kind {kind} has none; remove it or change kind"
        return f"{where[:LONGEST_KEY]}: unknown key; {did_you_mean(str(place[-1]), _keys(place))}"
    what = _what(detail)
    return f"{where}: {what}" if where else what  # a mistake of several sections names its keys in the message


WANTED = {  # texts by the type of pydantic's error, with its values
    "float_type": "a valid number",
    "int_type": "a valid integer",
    "string_type": "a text",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "model_type": "a table",
    "literal_error": "{expected}",
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "greater than or equal to {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "less than or equal to {le:g}",
}


def _what(detail: ErrorDetails) -> str:
    """Return what is wrong, by the type of the error, or the message of our own validator (`section.invalid`)."""
    values = detail.get("ctx", {})
    if "message" in values:
        return values["message"]
    match detail["type"]:
        case "missing":
            return "missing; add it"
        case "too_long":
            return f"must have at most {values['max_length']} items, not {values['actual_length']}"
        case "too_short":
            return f"must have at least {values['min_length']} items, not {values['actual_length']}"
        case kind if kind in WANTED:
            return f"must be {WANTED[kind].format(**values)}, not {reprlib.repr(detail['input'])}"
    return detail["msg"]
