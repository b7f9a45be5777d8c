"""Write records as MATLAB files: one struct of arrays per record, with the names of its fields.

Arrays have the same shapes as in Python; covariances are (rows, d, d). Steps count from 0, so `observation_step` k is
row k + 1 of `poses` in MATLAB. Fields without a value are omitted. Names of estimates become identifiers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from slamgauge.compare.storage.files import explained, flat_fields
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording
from slamgauge.truth import Truth

LONGEST = 63  # characters of a field's name


def write_mat(path: Path, records: Mapping[str, Recording | Truth | Estimate]) -> None:
    """Write one struct per record, by name; raise `UserError` if the file cannot be written."""
    from scipy.io import savemat  # imported here because it is slow and only this format needs it

    structs = {_identifier(name): _struct(record) for name, record in records.items()}
    with explained(path, "written"), path.open("wb") as file:
        savemat(file, structs, long_field_names=True, oned_as="column")


def _struct(record: Recording | Truth | Estimate) -> dict[str, Any]:
    return {name: np.asarray(value) if np.ndim(value) else value for name, value in flat_fields(record).items()}


def _identifier(name: str) -> str:
    """Return a valid Octave name: letters, digits and underscores, beginning with a letter."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:LONGEST]
    return plain if plain[:1].isalpha() else f"x{plain}"[:LONGEST]
