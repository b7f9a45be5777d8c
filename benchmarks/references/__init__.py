"""References for estimators, and the random recordings on which `benchmarks/agreement.py` compares them.

`recordings` draws recordings. `least_squares` is an optimum without the project's solvers, `extended` the filters in
extended precision. `filters` and `optima` compare, `verdicts` has the results, `table` sums them up. `seeded_bugs` is a
textbook EKF with one bug at a time, and `class_files` has made-up submissions. The textbook filters are in
`tests/reference`.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
