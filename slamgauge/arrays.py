"""Arrays as slamgauge uses them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Marks = NDArray[np.bool_]
