"""From words to a command: its options by tyro, its mistakes in one line."""

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
        """Carry it out; the exit status."""
        ...


CONFIG = (tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
ABOUT = (
    "How far is your SLAM filter from the best that its measurements allow? "
    "(`slamgauge --version` prints its version, `slamgauge COMMAND --help` the options of a command.)"
)
BAD_INPUT = 2  # exit status
IS_OPTION = re.compile(r"--|-[a-z]")  # and -1 is a number
OWN = ("-h", "--help", "--tyro-print-completion")  # options of tyro that are no command's
TOO_LONG = re.compile(r"Exceeds the limit \((\d+) digits\).*")  # of numbers; Python's advice is for programmers
REPEATED = ("For full helptext", "Argument helptext")  # what follows is told by --help


def parse(words: Sequence[str], commands: Mapping[str, type[Command]]) -> Command:
    """The command that the words after `slamgauge` ask for.

    Raises:
        UserError: there is no such command or option, or something is missing.
        SystemExit: help was asked for, and is printed.
    """
    if not words:
        raise UserError(f"no command is given; use one of {', '.join(commands)}, or --help")
    name = words[0]
    if name in commands:
        return _parsed(commands[name], f"slamgauge {name}", words[1:])
    if not name.startswith("-"):
        raise UserError(f"{name}: no such command; {did_you_mean(name, commands)}")
    if name not in OWN:
        raise UserError(f"{name}: no option of `slamgauge`; {did_you_mean(name, ('--version', '--help'))}")
    return _parsed(overview(commands), "slamgauge", words, ABOUT)


def overview(commands: Mapping[str, type[Command]]) -> Any:
    """All commands as one type, each with the first line of what it says of itself."""
    lines = {name: (getdoc(each) or "").partition("\n")[0] for name, each in commands.items()}
    alternatives = [
        Annotated[each, tyro.conf.subcommand(name=name, description=lines[name])] for name, each in commands.items()
    ]
    return Union[tuple(alternatives)]  # noqa: UP007 of types that are known at run time


def _parsed(kind: Any, program: str, words: Sequence[str], about: str | None = None) -> Command:
    told = StringIO()
    try:
        with redirect_stderr(told):
            return tyro.cli(kind, prog=program, description=about, args=words, config=CONFIG)
    except SystemExit as end:
        if end.code != BAD_INPUT:
            sys.stdout.flush()
            raise
    raise UserError(_mistake(kind, program, words, told.getvalue()))


def _mistake(kind: Any, program: str, words: Sequence[str], told: str) -> str:
    """What is wrong in one line: an option that does not exist with the nearest that does, or what tyro has told."""
    known = _options(kind, program, words)
    for word in words:
        option = word.partition("=")[0]
        if IS_OPTION.match(option) and known and option.replace("_", "-") not in known:
            return f"{option}: no option of `{program}`; {_remedy(option, known, program)}"
    lines = [line.strip("│| ") for line in told.splitlines() if re.search(r"\w", line)][1:]  # in tyro's box
    said = " ".join(takewhile(lambda line: not line.startswith(REPEATED), lines))
    said = TOO_LONG.sub(r"has more than \1 digits, give fewer", said)
    return f"{said.rstrip('.')}; `{program} --help` tells more"


def _remedy(option: str, known: set[str], program: str) -> str:
    """What to give instead of an option: the nearest by its name; that all begin with dashes makes none near."""
    near = near_names(option.lstrip("-"), [each.lstrip("-") for each in known])
    meant = [each for each in known if each.lstrip("-") in near]
    return f"did you mean {meant[0]}?" if meant else f"`{program} --help` lists them"


def _options(kind: Any, program: str, words: Sequence[str]) -> set[str]:
    """The options of a command, as its help has them at the head of a row: what else it names is other commands'."""
    before = list(takewhile(lambda word: not word.startswith("-"), words))
    told = StringIO()
    try:
        with redirect_stdout(told), redirect_stderr(StringIO()):
            tyro.cli(kind, prog=program, args=[*before, "--help"], config=CONFIG)
    except SystemExit:
        pass
    heads = re.findall(r"(?m)^[│ ] {1,2}(-.*?)(?:  |$)", told.getvalue())
    return {option for head in heads for option in re.findall(r"(?<![\w-])-(?:h|-[a-z][\w-]*)", head)}
