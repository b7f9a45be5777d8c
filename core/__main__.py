"""`python -m slamgauge` is the command `slamgauge`."""

import os
import sys

if __name__ == "__main__":
    # Python puts the current folder first in its path; a file there must not replace a library
    if not sys.flags.safe_path and sys.path[:1] in ([""], [os.getcwd()]):  # noqa: PTH109 pathlib is not loaded yet
        del sys.path[0]
    from slamgauge.compare.cli.main import main

    sys.exit(main())
