"""The command line: `slamgauge COMMAND`."""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()  # before numpy is imported

import errno
import signal
import sys
import threading
import traceback
from collections.abc import Generator, Sequence
from contextlib import contextmanager

from slamgauge.compare.cli.animate import Animate
from slamgauge.compare.cli.bench import Bench
from slamgauge.compare.cli.check import Check
from slamgauge.compare.cli.completion import Completion
from slamgauge.compare.cli.doctor import Doctor
from slamgauge.compare.cli.export import Export
from slamgauge.compare.cli.grade import Grade
from slamgauge.compare.cli.imports import Import
from slamgauge.compare.cli.noise import Noise
from slamgauge.compare.cli.options import EmptyPathError
from slamgauge.compare.cli.parsing import Command, parse
from slamgauge.compare.cli.report import Report
from slamgauge.compare.cli.run import Evaluate, Run
from slamgauge.compare.cli.scenarios import Scenarios
from slamgauge.compare.cli.schema import Schema
from slamgauge.compare.cli.streams import drop_output, prepare_streams, put
from slamgauge.compare.cli.study import Budget, Claims, Study
from slamgauge.compare.cli.terminal import Output, printed_as
from slamgauge.compare.cli.twin import MakeTwin
from slamgauge.compare.storage.provenance import commanded
from slamgauge.compare.storage.safe_names import shown
from slamgauge.errors import UserError, refused_by_the_machine
from slamgauge.version import __version__

DEFECT = 70  # exit status, EX_SOFTWARE of sysexits.h
REFUSED = 71  # EX_OSERR
INTERRUPTED = 128 + signal.SIGINT  # as shells tell it
# further signals that end a command as an interrupt does; Windows has no SIGHUP
ENDS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))

COMMANDS: dict[str, type[Command]] = {
    "scenarios": Scenarios,
    "run": Run,
    "evaluate": Evaluate,
    "import": Import,
    "export": Export,
    "twin": MakeTwin,
    "study": Study,
    "budget": Budget,
    "claims": Claims,
    "noise": Noise,
    "animate": Animate,
    "report": Report,
    "check": Check,
    "grade": Grade,
    "bench": Bench,
    "doctor": Doctor,
    "completion": Completion,
    "schema": Schema,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        The exit status: 0 done, 1 a row failed and the others are there, or a check did not hold, 2 bad input (one line
        on standard error), 70 a defect of slamgauge (its traceback and where to report it), 71 memory or room was
        lacking (one line), 130 interrupted, 143 terminated, 129 if its terminal is gone (SIGHUP).
    """
    prepare_streams()
    with _terminations() as came:
        status = _run(sys.argv[1:] if arguments is None else arguments)
    return 128 + came[0] if came and status == INTERRUPTED else status


def _run(words: Sequence[str]) -> int:
    """Run one command; its exit status, an end by any signal being an interrupt."""
    status = 0
    if list(words) == ["--version"]:
        return 0 if put(f"slamgauge {__version__}") else 1
    try:
        command = parse(words, COMMANDS)
        with commanded(words), printed_as(getattr(command, "output", Output())):
            status = command() or 0
    except (UserError, EmptyPathError) as error:
        lines = str(error).split("\n")  # the only end of a line that is ours: others are names'
        print("slamgauge: " + "\n".join(map(shown, lines)), file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever reads our help (`head`, a pager) has seen enough
        drop_output()
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            return _not_the_users_mistake(error)
        print(
            f"slamgauge: {str(error.filename)[:60]} ...: no file system has such a name; check the path",
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt as interrupt:
        print(f"slamgauge: interrupted; {str(interrupt) or 'nothing was written'}", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:  # noqa: BLE001 whatever else comes here has to be reported
        return _not_the_users_mistake(error)
    return status


@contextmanager
def _terminations() -> Generator[list[int]]:
    """Let a termination end the command as an interrupt does, which cleans up; those that came are listed."""
    came: list[int] = []

    def interrupt(number: int, _: object) -> None:
        signal.signal(number, signal.SIG_IGN)  # a second one shall not end what cleans up
        came.append(number)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # only there may signals be handled
        yield came
        return
    before = {number: signal.getsignal(number) for number in ENDS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # as `nohup` wants it
            signal.signal(number, interrupt)
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _not_the_users_mistake(error: Exception) -> int:
    """Say what the machine refused, or that this is a defect, and where to report it."""
    if refused_by_the_machine(error):
        what = " ".join(str(error).split()) or type(error).__name__
        print(f"slamgauge: the machine refused: {what}; make room and give the same command again", file=sys.stderr)
        return REFUSED
    traceback.print_exception(error)
    print(
        "slamgauge: this is a defect of slamgauge, not a mistake of yours; please report it to its maintainers "
        f"(CONTRIBUTING.md) with the lines above, the command and its version (slamgauge {__version__})",
        file=sys.stderr,
    )
    return DEFECT
