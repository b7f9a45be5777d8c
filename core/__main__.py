"""`python -m slamgauge` is the command `slamgauge`."""

import os
import sys

if __name__ == "__main__":
    # Python has put the current folder in front; a file there must not pass for a library that we import
    if not sys.flags.safe_path and sys.path[:1] in ([""], [os.getcwd()]):  # noqa: PTH109 pathlib is not loaded yet
        del sys.path[0]
    from slamgauge.compare.cli.main import main

    sys.exit(main())
