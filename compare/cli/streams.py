"""Standard streams: whatever is wrong with them, results are written, and what they cannot take costs no work."""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress


def prepare_streams() -> None:
    """Let streams take every character, stand in for those that are closed, and let talk on a full one be lost."""
    _fill_gaps()
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115 for as long as the process lives
    elif isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a name, or a sign that their encoding does not have
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
    elif sys.stderr is sys.__stderr__ and type(sys.stderr) is io.TextIOWrapper:
        encoding = sys.stderr.encoding
        sys.stderr = _Talk(sys.stderr.detach(), encoding, errors="backslashreplace", line_buffering=True)


def put(text: str) -> bool:
    """Print on standard output; whether that took it. A reader who has seen enough (`head`, a pager) counts as such."""
    try:
        print(text)
        sys.stdout.flush()
    except BrokenPipeError:
        drop_output()
    except OSError as error:
        drop_output()
        print(f"slamgauge: standard output: cannot be written ({error.strerror}); give it room", file=sys.stderr)
        return False
    return True


def drop_output() -> None:
    """Lead standard output nowhere, with what is still to be written there."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fill_gaps() -> None:
    """Open what is closed of the descriptors 0 to 2: a file of ours would get its number, and all that is said."""
    while (opened := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(opened, True)
    os.close(opened)


class _Talk(io.TextIOWrapper):
    """Standard error: notes and progress, of which nothing depends."""

    def write(self, text: str, /) -> int:
        with suppress(OSError):
            return super().write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()
