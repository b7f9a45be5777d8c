"""What benchmarks hold the estimators against: `benchmarks/agreement.py`, and what it draws to do so, above all.

`recordings` draws, `least_squares` is the optimum without the project's solvers, `extended` the filters in extended
precision, `filters` and `optima` compare, `kept` keeps, `table` sums up. `map_scale` is how much too large
a map is. The textbook filters are those of the tests.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
