"""Parse the words of a command line: options by tyro, each mistake in one line."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from importlib import import_module
from io import StringIO
from itertools import takewhile
from typing import Annotated, Any, NamedTuple, Union, get_args, get_type_hints

from slamgauge.compare.cli.options.shared import Options
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean, near_names


class Listed(NamedTuple):
    """A command in the list of commands.

    Attributes:
        options: `module:class` of its options in `cli/options`.
        module: module in this folder whose function `run` does the work, imported when the command is called.
        summary: what it does, in a line of help.
    """

    options: str
    module: str
    summary: str

    def load(self) -> type[Options]:
        """Import the class of the options."""
        module, _, name = self.options.partition(":")
        return getattr(import_module(f"slamgauge.compare.cli.options.{module}"), name)

    def run(self, options: Options) -> int | None:
        """Run the command and return the exit status; None is 0."""
        return import_module(f"slamgauge.compare.cli.{self.module}").run(options)


ABOUT = """usage: slamgauge COMMAND ...

Is your EKF-SLAM overconfident, and how much accuracy does it lose?

commands:
"""
MORE = """
`slamgauge COMMAND --help` prints the options of a command, `slamgauge --version` the version, and
`slamgauge --tyro-print-completion bash` (zsh, tcsh) a script that completes the words of a shell."""
COMPLETION = "--tyro-print-completion"
HELP = ("-h", "--help")
BAD_INPUT = 2  # exit status
REPEATED = ("For full helptext", "Argument helptext")  # beginnings of lines that only repeat --help


def parse(words: Sequence[str], commands: Mapping[str, Listed]) -> Options:
    """Return the options for the words after `slamgauge`; only their module is imported.

    Raises:
        UserError: a command or option does not exist, or something is missing.
        SystemExit: help was requested and printed.
    """
    if not words:
        raise UserError(f"no command is given; use one of {', '.join(commands)}, or --help")
    name = words[0]
    if name in commands:
        return _parsed(commands[name].load(), f"slamgauge {name}", words[1:])
    if name in HELP:
        print(ABOUT + "".join(f"  {name:9}  {each.summary}\n" for name, each in commands.items()) + MORE)
        raise SystemExit(0)
    if name == COMPLETION:
        return _parsed(_any_of(commands), "slamgauge", words)
    if name.startswith("-"):
        raise UserError(f"{name}: no option of `slamgauge`; {did_you_mean(name, ('--version', '--help'))}")
    raise UserError(f"{name}: no such command; {did_you_mean(name, commands)}")


def _any_of(commands: Mapping[str, Listed]) -> Any:
    """Return the union of all commands."""
    import tyro

    subcommand = tyro.conf.subcommand
    alternatives = [
        Annotated[each.load(), subcommand(name=name, description=each.summary)]  # pyrefly: ignore[invalid-annotation]
        for name, each in commands.items()
    ]
    return Union[tuple(alternatives)]  # noqa: UP007 types known at run time only  # pyrefly: ignore[invalid-annotation]


def _parsed(kind: Any, program: str, words: Sequence[str]) -> Options:
    import tyro

    config = (tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
    printed = StringIO()
    try:
        with redirect_stderr(printed):
            return tyro.cli(kind, prog=program, args=words, config=config)
    except SystemExit as end:
        if end.code != BAD_INPUT:
            sys.stdout.flush()
            raise
    raise UserError(_mistake(kind, program, words, printed.getvalue()))


def _mistake(kind: Any, program: str, words: Sequence[str], printed: str) -> str:
    """Return one line: an option that does not exist and the nearest that does, or the message in tyro's box."""
    known = {"help", "h", *_options(kind)}
    for word in words:
        option = word.partition("=")[0]
        name = option.lstrip("-").replace("_", "-")
        is_option = option.startswith("--") or (option.startswith("-") and name[:1].isalpha())  # -1 is a number
        if is_option and (name not in known or not option.startswith(("--", "-h"))):
            near = near_names(name, sorted(known))  # dashes make no names near
            remedy = f"did you mean --{near[0]}?" if near else f"`{program} --help` lists them"
            return f"{option}: no option of `{program}`; {remedy}"
    lines = [line.strip("│| ") for line in printed.splitlines() if any(map(str.isalnum, line))]
    message = " ".join(takewhile(lambda line: not line.startswith(REPEATED), lines[1:]))  # the first is the box's title
    return f"{message.rstrip('.')}; see `{program} --help`"


def _options(kind: Any) -> set[str]:
    """Return the names of the options of a dataclass, of the dataclasses in its fields, and of its subcommands."""
    if hasattr(kind, "__metadata__"):  # Annotated
        return _options(kind.__origin__)
    if not dataclasses.is_dataclass(kind):
        return set[str]().union(*map(_options, get_args(kind)))
    hints = get_type_hints(kind, include_extras=True)
    found = set[str]()
    for field in dataclasses.fields(kind):
        parts = _options(hints[field.name])
        found |= parts or {field.name.replace("_", "-")}
    return found
