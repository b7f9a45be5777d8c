"""Arrays as pages carry them: little-endian numbers in base64, which `unpack.js` reads."""

from __future__ import annotations

import base64
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

KINDS = {"f4": "<f4", "i4": "<i4", "u2": "<u2", "u1": "u1"}


def pack(values: ArrayLike, kind: Literal["f4", "i4", "u2", "u1"] = "f4") -> dict[str, Any]:
    """The numbers of an array, row by row; single precision, 1e-7 of a figure, is more than a screen shows."""
    content = np.ascontiguousarray(values, dtype=KINDS[kind])
    return {"kind": kind, "data": base64.b64encode(content.tobytes()).decode("ascii")}
