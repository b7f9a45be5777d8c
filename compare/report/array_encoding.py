"""Encode arrays for pages: little-endian numbers in base64, decoded by `unpack.js`."""

from __future__ import annotations

import base64
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

KINDS = {"f4": "<f4", "i4": "<i4", "u2": "<u2", "u1": "u1"}


def pack(values: ArrayLike, kind: Literal["f4", "i4", "u2", "u1"] = "f4") -> dict[str, Any]:
    """Encode an array row by row; single precision (relative 1e-7) is enough for a screen."""
    content = np.ascontiguousarray(values, dtype=KINDS[kind])
    return {"kind": kind, "data": base64.b64encode(content.tobytes()).decode("ascii")}
