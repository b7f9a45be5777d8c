"""A scenario as the text of a TOML file that makes the same one."""

from __future__ import annotations

from typing import Any

from slamgauge.compare.scenarios.csv_tables import TableText
from slamgauge.compare.scenarios.scenario import Scenario
from slamgauge.compare.scenarios.section import Section
from slamgauge.compare.storage.toml_tables import toml_text


def scenario_text(scenario: Scenario) -> str:
    """All that differs from the defaults, overrides included; CSV files stand in it by their names."""
    keys = {name: _plain(getattr(scenario, name)) for name in scenario.model_fields_set - {"name"}}
    ordered = {name: keys[name] for name in Scenario.model_fields if name in keys}
    top = {name: value for name, value in ordered.items() if not isinstance(value, dict)}
    return toml_text({"": top, **{name: value for name, value in ordered.items() if isinstance(value, dict)}})


def _plain(value: object) -> Any:
    """A section as a table of what was set in it; anything else as it is."""
    if isinstance(value, TableText):
        return value.name
    if isinstance(value, Section):
        names = [name for name in type(value).model_fields if name in value.model_fields_set]
        return {name: _plain(getattr(value, name)) for name in names}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
