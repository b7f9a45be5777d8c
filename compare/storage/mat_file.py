"""Records as MATLAB files, for Octave and MATLAB: a struct of plain arrays for each record, under its fields' names.

Arrays are as in Python: row k of `poses` is pose k, poses and steps count from 0 (`observation_step` k is row k + 1 of
`poses`), covariances are (rows, d, d). Fields that are None are left out. Names of estimates become identifiers.
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
    """Write records by name, each a struct.

    Raises:
        UserError: If the file cannot be written.
    """
    from scipy.io import savemat  # imported here: slow, and for this format alone

    structs = {_identifier(name): _struct(record) for name, record in records.items()}
    with explained(path, "written"), path.open("wb") as file:
        savemat(file, structs, long_field_names=True, oned_as="column")


def _struct(record: Recording | Truth | Estimate) -> dict[str, Any]:
    return {name: np.asarray(value) if np.ndim(value) else value for name, value in flat_fields(record).items()}


def _identifier(name: str) -> str:
    """A name as Octave takes it: letters, digits and underscores, a letter first."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:LONGEST]
    return plain if plain[:1].isalpha() else f"x{plain}"[:LONGEST]
