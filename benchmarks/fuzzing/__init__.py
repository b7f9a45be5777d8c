"""Cases of `benchmarks/fuzz.py`: damaged inputs of slamgauge and their results.

`mutations` damages files, `targets` lists the inputs and the checks of their results, `arguments` changes arguments of
commands, and `cases` runs one case after another in a process that may crash. The small logs are those of the tests.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
