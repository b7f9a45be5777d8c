"""What `benchmarks/agreement.py` holds the estimators against, and what it draws to do so.

`recordings` draws, `least_squares` is the optimum without the project's solvers, `extended` the filters in extended
precision, `filters` and `optima` compare, `table` sums up. The textbook filters are those of the tests.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "tests/reference"))
