"""Parse the words of a command line: options by tyro, each mistake in one line."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from inspect import getdoc
from io import StringIO
from itertools import takewhile
from typing import Annotated, Any, Protocol, Union

import tyro

from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean, near_names


class Command(Protocol):
    """A dataclass whose fields are the options."""

    def __call__(self) -> int | None:
        """Run the command and return the exit status; None is 0."""
        ...


CONFIG = (tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
ABOUT = (
    "Is your EKF-SLAM overconfident, and how much accuracy does it lose? "
    "(`slamgauge --version` prints its version, `slamgauge COMMAND --help` the options of a command.)"
)
BAD_INPUT = 2  # exit status
IS_OPTION = re.compile(r"--|-[a-z]")  # -1 is a number
OF_TYRO = ("-h", "--help", "--tyro-print-completion")  # options of `slamgauge` itself
TOO_LONG = re.compile(r"Exceeds the limit \((\d+) digits\).*")  # Python's error for long numbers, with its advice
REPEATED = ("For full helptext", "Argument helptext")  # beginnings of lines that only repeat --help


def parse(words: Sequence[str], commands: Mapping[str, type[Command]]) -> Command:
    """Return the command for the words after `slamgauge`.

    Raises:
        UserError: a command or option does not exist, or something is missing.
        SystemExit: help was requested and printed.
    """
    if not words:
        raise UserError(f"no command is given; use one of {', '.join(commands)}, or --help")
    name = words[0]
    if name in commands:
        return _parsed(commands[name], f"slamgauge {name}", words[1:])
    if not name.startswith("-"):
        raise UserError(f"{name}: no such command; {did_you_mean(name, commands)}")
    if name not in OF_TYRO:
        raise UserError(f"{name}: no option of `slamgauge`; {did_you_mean(name, ('--version', '--help'))}")
    lines = {name: (getdoc(each) or "").partition("\n")[0] for name, each in commands.items()}
    alternatives = [
        Annotated[each, tyro.conf.subcommand(name=name, description=lines[name])]  # pyrefly: ignore[invalid-annotation]
        for name, each in commands.items()
    ]
    return _parsed(Union[tuple(alternatives)], "slamgauge", words, ABOUT)  # noqa: UP007 types known at run time only  # pyrefly: ignore[invalid-annotation]


def _parsed(kind: Any, program: str, words: Sequence[str], about: str | None = None) -> Command:
    printed = StringIO()
    try:
        with redirect_stderr(printed):
            return tyro.cli(kind, prog=program, description=about, args=words, config=CONFIG)
    except SystemExit as end:
        if end.code != BAD_INPUT:
            sys.stdout.flush()
            raise
    raise UserError(_mistake(kind, program, words, printed.getvalue()))


def _mistake(kind: Any, program: str, words: Sequence[str], printed: str) -> str:
    """Return one line: an option that does not exist and the nearest that does, or the message that tyro printed."""
    known = _options(kind, program, words)
    for word in words:
        option = word.partition("=")[0]
        if IS_OPTION.match(option) and known and option.replace("_", "-") not in known:
            near = near_names(option.lstrip("-"), [each.lstrip("-") for each in known])  # dashes make no names near
            meant = [each for each in known if each.lstrip("-") in near]
            remedy = f"did you mean {meant[0]}?" if meant else f"`{program} --help` lists them"
            return f"{option}: no option of `{program}`; {remedy}"
    lines = [line.strip("│| ") for line in printed.splitlines() if re.search(r"\w", line)][1:]  # inside tyro's box
    message = " ".join(takewhile(lambda line: not line.startswith(REPEATED), lines))
    message = TOO_LONG.sub(r"has more than \1 digits, give fewer", message)
    return f"{message.rstrip('.')}; see `{program} --help`"


def _options(kind: Any, program: str, words: Sequence[str]) -> set[str]:
    """Return the options of a command: those at the head of a row of its help. Other options there are mentions."""
    before = list(takewhile(lambda word: not word.startswith("-"), words))
    printed = StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(StringIO()):
            tyro.cli(kind, prog=program, args=[*before, "--help"], config=CONFIG)
    except SystemExit:
        pass
    heads = re.findall(r"(?m)^[│ ] {1,2}(-.*?)(?:  |$)", printed.getvalue())
    return {option for head in heads for option in re.findall(r"(?<![\w-])-(?:h|-[a-z][\w-]*)", head)}
