"""The command line: `slamgauge COMMAND`."""

from __future__ import annotations

from slamgauge.compare.studies.executors import pin_blas_threads

pin_blas_threads()  # before numpy is imported

import os
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from slamgauge.compare.cli.animate import Animate
from slamgauge.compare.cli.bench import Bench
from slamgauge.compare.cli.imports import Import
from slamgauge.compare.cli.many_runs import Budget, Claims, Study
from slamgauge.compare.cli.one_run import Evaluate, Run
from slamgauge.compare.cli.options import EmptyPathError
from slamgauge.compare.cli.scenarios import Scenarios

Command = (
    Annotated[Scenarios, tyro.conf.subcommand(name="scenarios")]
    | Annotated[Run, tyro.conf.subcommand(name="run")]
    | Annotated[Evaluate, tyro.conf.subcommand(name="evaluate")]
    | Annotated[Import, tyro.conf.subcommand(name="import")]
    | Annotated[Study, tyro.conf.subcommand(name="study")]
    | Annotated[Budget, tyro.conf.subcommand(name="budget")]
    | Annotated[Claims, tyro.conf.subcommand(name="claims")]
    | Annotated[Animate, tyro.conf.subcommand(name="animate")]
    | Annotated[Bench, tyro.conf.subcommand(name="bench")]
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; exit status 0 done, 2 bad input (one line on standard error), 130 interrupted."""
    try:
        command = tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]
            prog="slamgauge",
            description="How far is your SLAM filter from the best that its measurements allow?",
            args=arguments,
            config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
        )
        command()
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads our output (`head`, a pager) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (ValueError, EmptyPathError) as error:
        print(f"slamgauge: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as interrupt:
        print(f"slamgauge: interrupted; {str(interrupt) or 'nothing was written'}", file=sys.stderr)
        return 130
    return 0
