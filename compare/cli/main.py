"""The command line: `slamgauge COMMAND`."""

from __future__ import annotations

import errno
import signal
import sys
import threading
import traceback
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import Any

from slamgauge.compare.cli.options.shared import EmptyPathError
from slamgauge.compare.cli.parsing import Listed, parse
from slamgauge.compare.cli.terminal import drop_output, prepare_streams, put
from slamgauge.compare.storage.result_files import commanded
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError, no_room_for_library, refused_by_the_machine
from slamgauge.version import __version__

DEFECT = 70  # exit status, EX_SOFTWARE of sysexits.h
REFUSED = 71  # EX_OSERR
LONGEST = 200  # characters of the machine's own message
# signals that interrupt a command; Windows has no SIGHUP
ENDS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

COMMANDS = {
    "exercise": Listed("exercise:ExerciseCommand", "exercise", "the exercise TP4: EKF, GTSAM batch and optimum"),
    "scenarios": Listed("machine:Scenarios", "scenarios", "list the shipped scenarios"),
    "run": Listed("run:Run", "run", "simulate one run of a scenario and score estimators on it"),
    "evaluate": Listed("run:Evaluate", "evaluate", "score estimators, your own among them, on a recording"),
    "import": Listed("imports:Import", "imports", "convert the log of a robot, or a published recording"),
    "export": Listed("exports:Export", "exports", "write results in a format of other programs"),
    "twin": Listed("recordings:Twin", "twin", "make a scenario that is like a recording"),
    "study": Listed("study:Study", "study", "many independent runs, their statistics and figures"),
    "budget": Listed("study:Budget", "budget", "split a filter's error into its causes"),
    "noise": Listed("recordings:Noise", "noise", "estimate the noise of a recording, with intervals"),
    "animate": Listed("animate:Animate", "animate", "draw a run as a moving picture"),
    "check": Listed("user_filters:Check", "check", "test a filter; a failed check names the part that is wrong"),
    "grade": Listed("user_filters:Grade", "grade", "grade a folder of submissions"),
    "bench": Listed("machine:Bench", "bench", "measure step times for several map sizes"),
    "doctor": Listed("machine:Doctor", "doctor", "print what a bug report needs"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        The exit status: 0 done, 1 an estimator or a check failed and the other results are kept, 2 bad input (one line
        on standard error), 70 a defect of slamgauge (with a traceback), 71 too little memory or disk space (one line),
        130 interrupted, 143 terminated, 129 terminal closed (SIGHUP).
    """
    prepare_streams()
    with _interrupting_signals() as received:
        try:
            return _run(sys.argv[1:] if arguments is None else arguments)
        except KeyboardInterrupt as interrupt:
            number = received[0] if received else signal.SIGINT
            return _ended(128 + number, f"interrupted; {str(interrupt) or 'nothing was written'}")


def _run(words: Sequence[str]) -> int:
    """Run one command and return its exit status, except after an interrupt."""
    if list(words) == ["--version"]:
        put(f"slamgauge {__version__}")
        return 0
    try:
        options = parse(words, COMMANDS)
        options.check()
        with commanded(words):
            return COMMANDS[words[0]].run(options) or 0
    except (UserError, EmptyPathError) as error:
        lines = str(error).split("\n")  # `shown` escapes the other line ends, which are parts of names
        return _ended(2, "\n".join(map(shown, lines)))
    except BrokenPipeError:  # the reader of our help (`head`, a pager) closed the pipe
        drop_output()
        return 0
    except Exception as error:  # noqa: BLE001 every other error is reported as a defect
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            return _ended(2, f"{str(error.filename)[:60]} ...: this name is too long; check the path")
        if refused_by_the_machine(error):
            what = " ".join(str(error).split())[:LONGEST] or "too little memory"
            if no_room_for_library(error):
                what = (
                    "the libraries do not fit into the memory that this process may use (`ulimit -v` prints the limit)"
                )
            return _ended(REFUSED, f"the machine refused: {what}; make room and give the same command again")
        traceback.print_exception(error)
        return _ended(
            DEFECT,
            "this is a defect of slamgauge, not a mistake of yours; please report it to its maintainers "
            f"(CONTRIBUTING.md) with the lines above, the command and its version (slamgauge {__version__})",
        )


def _ended(status: int, message: str) -> int:
    print(f"slamgauge: {message}", file=sys.stderr)
    return status


@contextmanager
def _interrupting_signals() -> Generator[list[int]]:
    """Let the signals that end a command interrupt it, so that it cleans up; yield the numbers of those that came."""
    received: list[int] = []

    def interrupt(number: int, _: object) -> None:
        received.append(number)
        raise KeyboardInterrupt

    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # Python handles signals there only
        before = {number: signal.getsignal(number) for number in ENDS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # `nohup` ignores SIGHUP, the shell SIGINT in the background
            signal.signal(number, interrupt)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
