"""What `benchmarks/fuzz.py` does to every input of slamgauge, and how it tells what came of it.

`mutations` damages, `targets` and `stores` list the inputs and what is claimed of them, `cases` carries one out,
`worker` does so in a process that may die. The small logs are those of the tests.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
