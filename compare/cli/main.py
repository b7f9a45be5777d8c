"""The command line: `slamgauge COMMAND`. A command is the class `Command` of the module of its name in this folder."""

from __future__ import annotations

import dataclasses
import errno
import importlib
import re
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
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from slamgauge.compare.cli.terminal import drop_output, prepare_streams, put
from slamgauge.compare.storage.result_files import commanded, shown
from slamgauge.errors import UserError, refused_by_the_machine
from slamgauge.suggestions import did_you_mean, near_names
from slamgauge.version import __version__

BAD_INPUT = 2  # exit status
DEFECT = 70  # EX_SOFTWARE of sysexits.h
REFUSED = 71  # EX_OSERR
LONGEST = 200  # characters of the machine's own message
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
ABOUT = """usage: slamgauge COMMAND ...

Is your EKF-SLAM overconfident, and how much accuracy does it lose?

commands:
"""
MORE = """
`slamgauge COMMAND --help` prints the options of a command, `slamgauge --version` the version, and
`slamgauge --tyro-print-completion bash` (zsh, tcsh) a script that completes the words of a shell."""
COMPLETION = "--tyro-print-completion"
HELP = {"-h", "--help"}


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
        command = parse(words)
        with commanded(words):
            return command.run()
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
            what = " ".join(str(error).split())[:LONGEST] or "too little memory"
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
        UserError: a command or option does not exist, or something is missing.
        SystemExit: help was requested and printed.
    """
    if not words:
        raise UserError(f"no command is given; use one of {', '.join(COMMANDS)}, or --help")
    name = words[0]
    if name in COMMANDS:
        return _parsed(load(name), f"slamgauge {name}", words[1:])
    if name in HELP:
        print(ABOUT + "".join(f"  {name:9}  {summary}\n" for name, summary in COMMANDS.items()) + MORE)
        raise SystemExit(0)
    if name == COMPLETION:
        return _parsed(_any_command(), "slamgauge", words)
    if name.startswith("-"):
        raise UserError(f"{name}: no option of `slamgauge`; {did_you_mean(name, ('--version', '--help'))}")
    raise UserError(f"{name}: no such command; {did_you_mean(name, COMMANDS)}")


class _Lazily(MetaPathFinder):
    """Finds the modules of slamgauge as usual, and lets each run when it is first used instead of when it is imported.

    Then a module of a command imports all that it needs at its head, and help and usage errors load no slow library.
    """

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


def _any_command() -> Any:
    """Return the union of all commands."""
    import tyro

    named = [Annotated[load(name), tyro.conf.subcommand(name=name, description=COMMANDS[name])] for name in COMMANDS]  # pyrefly: ignore[invalid-annotation]
    return Union[tuple(named)]  # noqa: UP007 types known at run time only  # pyrefly: ignore[invalid-annotation]


def _parsed(kind: Any, program: str, words: Sequence[str]) -> Any:
    import tyro

    config = (tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
    try:
        with redirect_stderr(StringIO()):  # tyro's own boxes
            command, others = tyro.cli(kind, prog=program, args=words, config=config, return_unknown_args=True)
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
    """Return a line about a wrong format, about the first option with a value of the wrong type, or missing words."""
    options, union = _options(kind), get_args(get_type_hints(kind).get("format"))
    formats = [re.sub(r"(?<=[a-z])(?=[A-Z])", "-", each.__name__).lower() for each in union]
    if formats and words and words[0] not in formats:
        return f"{words[0]}: no such format; {did_you_mean(words[0], formats)}"
    if formats and words:
        kind, program = union[formats.index(words[0])], f"{program} {words[0]}"
    for word, following in zip(words, [*words, ""][1:], strict=True):
        option, equals, value = word.partition("=")
        form = options.get(option.removeprefix("--").replace("_", "-")) if option.startswith("--") else None
        value = value if equals else following
        if get_origin(form) is Literal and value not in get_args(form):
            choices = ", ".join(get_args(form))
            return f"{option}: {value!r} is not one of {choices}; {did_you_mean(value, get_args(form))}"
        for number in {int, float} & {form, *get_args(form)}:
            try:
                number(value)
            except ValueError:
                what = "a whole number" if number is int else "a number"
                return f"{option}: {value!r} is not {what}; see `{program} --help`"
    needed = [each.name for each in dataclasses.fields(kind) if each.default is each.default_factory]
    needs = " and ".join([*needed, "a value behind each option"])
    return f"words are missing: `{program}` needs {needs}; see `{program} --help`"


def _options(kind: Any) -> dict[str, Any]:
    """Return the types of the options of a dataclass, of the dataclasses in its fields, and of its subcommands."""
    if not dataclasses.is_dataclass(kind):
        return {name: form for each in get_args(kind) for name, form in _options(each).items()}
    hints, found = get_type_hints(kind), dict[str, Any]()
    for field in dataclasses.fields(kind):
        form = hints[field.name]
        found |= _options(form) or {field.name.replace("_", "-"): form}
    return found
