"""Settings of imports from TOML files and `--set`, validated by pydantic."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypeVar, get_type_hints

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from slamgauge.compare.storage.toml_tables import Table, override, read_toml
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean
from slamgauge.validation import LARGEST

LONGEST_KEY, LONGEST_VALUE = 100, 40  # characters in messages

Number = Annotated[float, Field(gt=-LARGEST, lt=LARGEST)]
Sigma = Annotated[float, Field(ge=0.0, lt=LARGEST)]  # standard deviation of a motion or a start, possibly zero
SensorSigma = Annotated[float, Field(gt=0.0, lt=LARGEST)]
Text = Annotated[str, Field(min_length=1)]
Id = Annotated[int, Field(ge=0)]
Pose = tuple[Number, Number, Number]
Settings = TypeVar("Settings")


class Section:
    """Base of dataclasses of settings: unknown keys are refused."""

    __pydantic_config__ = ConfigDict(extra="forbid")


def load_settings(kind: type[Settings], file: Path | None, overrides: Sequence[str]) -> Settings:
    """Load settings of a dataclass from a TOML file.

    Args:
        kind: A dataclass of sections, which are dataclasses; unknown keys are refused.
        file: The file; None for defaults only.
        overrides: `section.key=value`, on top of the file.

    Raises:
        UserError: the file cannot be read, or a key or a value in it is wrong.
    """
    table: Table = {} if file is None else read_toml(file)
    for text in overrides:
        override(table, text)
    try:
        return TypeAdapter(kind).validate_json(json.dumps(table, default=str), strict=True)
    except ValidationError as error:
        raise UserError(f"{file or '--set'}: {mistake(error, kind)}") from None


def mistake(error: ValidationError, kind: type) -> str:
    """Return the first mistake in a line: the key, the rule and the value."""
    first = error.errors(include_url=False)[0]
    *sections, key = map(str, first["loc"])
    where = ".".join([*sections, key])[:LONGEST_KEY]
    if first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        for section in sections:
            kind = get_type_hints(kind)[section]
        return f"{where}: unknown {'key' if sections else 'section'}; {did_you_mean(key, get_type_hints(kind))}"
    rule = first["msg"]
    return f"{where}: {rule[0].lower()}{rule[1:]}, not {str(first['input'])[:LONGEST_VALUE]!r}; correct it"
