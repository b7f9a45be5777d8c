"""`python -m slamgauge` is the command `slamgauge`."""

import os
import signal
import sys


def start() -> int:
    """Run the command; before and after it, an interrupt ends the process without a traceback."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # the shell ignores interrupts of background commands
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from slamgauge.compare.cli.main import main

    return main()


if __name__ == "__main__":
    # Python puts the current folder first in its path; a file there must not replace a library
    if not sys.flags.safe_path and sys.path[:1] in ([""], [os.getcwd()]):  # noqa: PTH109 pathlib is not loaded yet
        del sys.path[0]
    sys.exit(start())
