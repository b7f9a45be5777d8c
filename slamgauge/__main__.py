"""`python -m slamgauge` is the command `slamgauge`."""

import sys

from slamgauge.compare.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
