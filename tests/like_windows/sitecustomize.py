"""Remove what Windows lacks, in every Python process with this folder on PYTHONPATH."""

import os
import signal
import sys

for name in ("fcntl", "resource", "pwd", "grp", "termios", "gtsam"):
    sys.modules[name] = None  # pyrefly: ignore[unsupported-operation]  # importing it fails
for name in ("killpg", "O_NOFOLLOW", "O_NONBLOCK", "O_DIRECTORY", "O_PATH", "sysconf"):
    delattr(os, name)
del signal.SIGHUP
