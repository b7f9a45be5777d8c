"""The command line: `slamgauge COMMAND`. A command is the class `Command` of the module of its name in this folder."""

from __future__ import annotations

import dataclasses
import errno
import importlib
import re
import shlex
import signal
import sys
import threading
import traceback
from collections.abc import Generator, Sequence
from contextlib import contextmanager, redirect_stderr
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import LazyLoader
from io import StringIO
from types import ModuleType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import tyro

from slamgauge.compare.cli.terminal import drop_output, prepare_streams, put
from slamgauge.compare.storage.result_files import COMMAND, shown
from slamgauge.errors import UserError, failure_text, refused_by_the_machine
from slamgauge.suggestions import did_you_mean, near_names
from slamgauge.version import __version__

BAD_INPUT = 2  # exit status
DEFECT = 70  # EX_SOFTWARE of sysexits.h
REFUSED = 71  # EX_OSERR
CONFIG = (tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
NUMBERS = {int: "a whole number", float: "a number"}
# signals that interrupt a command; Windows has no SIGHUP
ENDS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

COMMANDS = {
    "exercise": "the exercise TP4: EKF, GTSAM batch and optimum",
    "scenarios": "list the shipped scenarios",
    "run": "simulate one run of a scenario and score estimators on it",
    "evaluate": "score estimators, your own among them, on a recording",
    "import": "convert the log of a robot, or a published recording",
    "export": "write results in a format of other programs",
    "twin": "make a scenario that is like a recording",
    "study": "many independent runs, their statistics and figures",
    "budget": "split a filter's error into its causes",
    "noise": "estimate the noise of a recording, with intervals",
    "animate": "draw a run as a moving picture",
    "check": "test a filter; a failed check names the part that is wrong",
    "grade": "grade a folder of submissions",
    "bench": "measure step times for several map sizes",
    "doctor": "print what a bug report needs",
}
MODULES = {"import": "imports", "export": "exports"}  # Python reserves the word `import`
HELP = """usage: slamgauge COMMAND ...

Is your EKF-SLAM overconfident, and how much accuracy does it lose?

commands:
{}

`slamgauge COMMAND --help` prints the options of a command, `slamgauge --version` the version, and
`slamgauge --tyro-print-completion bash` (zsh, tcsh) a script that completes the words of a shell."""
COMPLETION = "--tyro-print-completion"


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
        except KeyboardInterrupt:
            number = received[0] if received else signal.SIGINT
            return _ended(128 + number, "interrupted; the same command runs again, a study from its finished runs on")


def _run(words: Sequence[str]) -> int:
    """Run one command and return its exit status, except after an interrupt."""
    if list(words) == ["--version"]:
        put(f"slamgauge {__version__}")
        return 0
    try:
        COMMAND.set(shlex.join(["slamgauge", *words]))
        return parse(words).run()
    except UserError as error:
        lines = str(error).split("\n")  # `shown` escapes the other line ends, which are parts of names
        return _ended(BAD_INPUT, "\n".join(map(shown, lines)))
    except BrokenPipeError:  # the reader of our help (`head`, a pager) closed the pipe
        drop_output()
        return 0
    except Exception as error:  # noqa: BLE001 every other error is reported as a defect
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            return _ended(BAD_INPUT, f"{str(error.filename)[:60]} ...: this name is too long; check the path")
        if refused_by_the_machine(error):
            what = f"the machine refused: {failure_text(error)}"
            return _ended(REFUSED, f"{what}; make room and give the same command again")
        traceback.print_exception(error)
        return _ended(
            DEFECT,
            "this is a defect of slamgauge, not a mistake of yours; please report it to its maintainers "
            f"(CONTRIBUTING.md) with the lines above, the command and its version (slamgauge {__version__})",
        )
    finally:
        COMMAND.set(None)


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
        heeded = (number for number in ENDS if signal.getsignal(number) is not signal.SIG_IGN)  # as `nohup` does
        before = {number: signal.signal(number, interrupt) for number in heeded}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def parse(words: Sequence[str]) -> Any:
    """Return the command with its options for the words after `slamgauge`; only its own module is imported.

    Raises:
        UserError: a command, format or option does not exist, or something is missing.
        SystemExit: help was requested and printed.
    """
    if not words:
        raise UserError(f"no command is given; use one of {', '.join(COMMANDS)}, or --help")
    name, *options = words
    if name in ("-h", "--help"):
        print(HELP.format("\n".join(f"  {name:9}  {summary}" for name, summary in COMMANDS.items())))
        raise SystemExit(0)
    if name == COMPLETION:
        every = {each: load(each) for each in COMMANDS}
        return tyro.extras.subcommand_cli_from_dict(every, prog="slamgauge", args=words, config=CONFIG)
    if name.startswith("-"):
        raise UserError(f"{name}: no option of `slamgauge`; {did_you_mean(name, ('--version', '--help'))}")
    if name not in COMMANDS:
        raise UserError(f"{name}: no such command; {did_you_mean(name, COMMANDS)}")
    command, program = load(name), f"slamgauge {name}"
    if (union := get_type_hints(command).get("format")) and options and not options[0].startswith("-"):
        formats = {re.sub(r"(?<=[a-z])(?=[A-Z])", "-", each.__name__).lower(): each for each in get_args(union)}
        form, *options = options
        if form not in formats:
            raise UserError(f"{form}: no such format; {did_you_mean(form, formats)}")
        command, program = formats[form], f"{program} {form}"
    return _parsed(command, program, options)


class _Lazily(MetaPathFinder):
    """Lets modules of slamgauge run when they are first used: commands import all they need, and help stays fast."""

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> ModuleSpec | None:
        if not fullname.startswith("slamgauge."):
            return None
        others = (finder.find_spec(fullname, path, target) for finder in sys.meta_path if finder is not self)
        spec = next(filter(None, others), None)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def load(name: str) -> Any:
    """Import the class of a command; the modules that its module imports from packages run when they are first used."""
    sys.meta_path.insert(0, lazily := _Lazily())
    try:
        return importlib.import_module(f"slamgauge.compare.cli.{MODULES.get(name, name)}").Command
    finally:
        sys.meta_path.remove(lazily)


def _parsed(kind: Any, program: str, words: Sequence[str]) -> Any:
    try:
        with redirect_stderr(StringIO()):  # tyro's own boxes
            command, others = tyro.cli(kind, prog=program, args=words, config=CONFIG, return_unknown_args=True)
    except SystemExit as end:
        if end.code != BAD_INPUT:
            sys.stdout.flush()
            raise
        raise UserError(_mistake(kind, program, words)) from None
    if not others:
        return command
    option = others[0].partition("=")[0]
    if not option.startswith("-"):
        raise UserError(f"{option}: one word too many; see `{program} --help`")
    near = near_names(option.lstrip("-").replace("_", "-"), ["help", *_options(kind)])  # dashes make no names near
    remedy = f"did you mean --{near[0]}?" if near else f"`{program} --help` lists them"
    raise UserError(f"{option}: no option of `{program}`; {remedy}")


def _mistake(kind: Any, program: str, words: Sequence[str]) -> str:
    """Return a line about the first option with a value of the wrong type, or about missing words."""
    options = _options(kind)
    for word, following in zip(words, [*words, ""][1:], strict=True):
        option, equals, value = word.partition("=")
        form = options.get(option.removeprefix("--").replace("_", "-")) if option.startswith("--") else None
        value = value if equals else following
        if get_origin(form) is Literal and value not in get_args(form):
            choices = ", ".join(get_args(form))
            return f"{option}: {value!r} is not one of {choices}; {did_you_mean(value, get_args(form))}"
        for number in NUMBERS.keys() & {form, *get_args(form)}:
            try:
                number(value)
            except ValueError:
                return f"{option}: {value!r} is not {NUMBERS[number]}; see `{program} --help`"
    needed = [each.name for each in dataclasses.fields(kind) if each.default is each.default_factory]
    needs = " and ".join([*needed, "a value behind each option"])
    return f"words are missing: `{program}` needs {needs}; see `{program} --help`"


def _options(kind: Any) -> dict[str, Any]:
    """Return the types of the options of a dataclass, and of the dataclasses in its fields."""
    hints, found = get_type_hints(kind), dict[str, Any]()
    for field in dataclasses.fields(kind):
        form = hints[field.name]
        found |= _options(form) if dataclasses.is_dataclass(form) else {field.name.replace("_", "-"): form}
    return found
