"""Cases: an input is chosen, damaged and read, in a process that is restarted when it crashes or hangs."""

from __future__ import annotations

import multiprocessing
import resource
import signal
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fuzzing.arguments import ARGUMENTS, run_arguments
from fuzzing.targets import Target, targets
from slamgauge import Recording, UserError
from slamgauge.compare.scenarios.scenario import ScenarioError
from slamgauge.ekf.estimators import ekf_slam
from slamgauge.errors import refused_by_the_machine

REFUSED, ACCEPTED = "refused in one line", "accepted"
TRACEBACK, HANG, CRASH, ALTERED = "traceback", "hang", "crash", "silently altered"
OUTCOMES = (REFUSED, ACCEPTED, TRACEBACK, HANG, CRASH, ALTERED)
LONGEST = 1000  # characters of a line
WAITING = 10  # clock time of a case without an answer, in units of the limit of processor time
ARGUMENTS_OF = 50  # one case in 50 changes arguments, which takes a hundred times longer
PROCESSES = multiprocessing.get_context("fork")  # the child has the loaded and compiled code of its parent


class Result(NamedTuple):
    """Outcome of a case; `detail` describes an outcome that should not occur."""

    target: str
    outcome: str
    detail: str = ""


@cache
def all_targets() -> dict[str, Target]:
    """Make the inputs once."""
    with tempfile.TemporaryDirectory() as folder:
        return {target.name: target for target in targets(Path(folder))}


def names() -> list[str]:
    """Return the inputs in the order of the table."""
    return [*all_targets(), ARGUMENTS]


def run_case(seed: int, case: int) -> Result:
    """Damage an input and read it in a temporary folder; seed and case determine everything."""
    rng, name = _draw(seed, case)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            if name == ARGUMENTS:
                return Result(name, *run_arguments(rng, Path(folder)))
            return Result(name, *_read(all_targets()[name], rng, Path(folder)))
        except UserError as error:
            return Result(name, *_refusal(error))
        except Exception as error:  # noqa: BLE001 the result reports every exception
            if refused_by_the_machine(error):
                return Result(name, REFUSED)
            return Result(name, TRACEBACK, f"{type(error).__name__}: {error} ({_where(error)})"[:300])


def _draw(seed: int, case: int) -> tuple[np.random.Generator, str]:
    """Return the random generator and the input of a case."""
    rng = np.random.default_rng([seed, case])
    return rng, ARGUMENTS if rng.integers(ARGUMENTS_OF) == 0 else str(rng.choice([*all_targets()]))


def _read(target: Target, rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """Damage one file of an input and read the input."""
    for name, content in target.files.items():
        (folder / name).write_bytes(content)
    is_sealed = bool(target.sealed) and rng.random() < 0.5
    among: Sequence[Any] = target.sealed if is_sealed else target.mutations
    name = [*target.files][int(rng.integers(len(target.files)))] if target.name != "--set" else "set"
    (folder / name).write_bytes(among[int(rng.integers(len(among)))](target.files[name], rng))
    result = target.read(folder)
    altered = target.check(folder, result)
    if is_sealed and result != _undamaged(target.name):
        altered = "the result differs from that of the undamaged file"
    if isinstance(result, Recording) and not np.isfinite(ekf_slam(result).poses).all():
        raise ArithmeticError("an accepted recording gives poses that are not finite")
    return (ALTERED, altered) if altered else (ACCEPTED, "")


@cache
def _undamaged(name: str) -> object:
    target = all_targets()[name]
    with tempfile.TemporaryDirectory() as folder:
        for file, content in target.files.items():
            (Path(folder) / file).write_bytes(content)
        return target.read(Path(folder))


def _refusal(error: UserError) -> tuple[str, str]:
    lines = str(error).split("\n")  # the command escapes other line endings
    is_told = len(lines) == 1 or (isinstance(error, ScenarioError) and lines)
    return (REFUSED, "") if is_told and max(map(len, lines)) < LONGEST else (TRACEBACK, f"not a line: {error!s:.200}")


def _where(error: BaseException) -> str:
    """Return the innermost line of the project in a traceback."""
    trace, where = error.__traceback__, ""
    while trace is not None:
        path = Path(trace.tb_frame.f_code.co_filename)
        if "site-packages" not in path.parts and "lib" not in path.parts:
            where = f"{path.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return where


def run_cases(seed: int, cases: Iterable[int], seconds: float, memory: int) -> Iterator[tuple[int, Result]]:
    """Run the cases in a child process with a limit of processor time [s] per case and of `memory` [bytes].

    A case that waits, and so uses no processor time, ends after `WAITING` times the limit.
    """
    left = [*cases]
    while left:
        ours, theirs = PROCESSES.Pipe()
        process = PROCESSES.Process(
            target=_serve, args=(theirs, seed, left, seconds, memory)
        )  # not a daemon: it has children
        process.start()
        theirs.close()
        try:
            while left:
                try:
                    result = ours.recv() if ours.poll(WAITING * seconds) else None
                except EOFError:  # the process has ended
                    result = None
                if result is None:
                    process.kill()
                    process.join()
                    is_hang = process.exitcode in (-signal.SIGKILL, -signal.SIGPROF)
                    detail = f"no answer after {seconds:g} s" if is_hang else f"exit code {process.exitcode}"
                    yield left[0], Result(_draw(seed, left.pop(0))[1], HANG if is_hang else CRASH, detail)
                    break
                yield left.pop(0), result
        finally:
            process.kill()
            process.join()
            ours.close()


def _serve(answers: Any, seed: int, cases: list[int], seconds: float, memory: int) -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles interrupts
    for case in cases:
        signal.setitimer(signal.ITIMER_PROF, seconds)  # it counts processor time, and its signal ends the process
        answers.send(run_case(seed, case))
