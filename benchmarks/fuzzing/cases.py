"""One case: an input is chosen, damaged and taken; what came of it."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fuzzing.arguments import ARGUMENTS, give_arguments
from fuzzing.targets import Target, targets
from slamgauge import Recording, UserError
from slamgauge.compare.scenarios.scenario import ScenarioError
from slamgauge.ekf.estimators import ekf_slam
from slamgauge.ekf.kernels.warm_up import compile_association_once, compile_bearings_once
from slamgauge.errors import refused_by_the_machine

REFUSED, ACCEPTED = "refused in one line", "accepted"
TRACEBACK, HANG, CRASH, ALTERED = "traceback", "hang", "crash", "silently altered"
OUTCOMES = (REFUSED, ACCEPTED, TRACEBACK, HANG, CRASH, ALTERED)
LONGEST = 1000  # characters of a line
ARGUMENTS_OF = 50  # one case of so many is of arguments, which take a hundred times longer


class Tried(NamedTuple):
    """What came of a case; `detail` says more of what should not be."""

    target: str
    outcome: str
    detail: str = ""


@cache
def whole() -> tuple[Target, ...]:
    """The inputs, made once, and kernels compiled that filters run on them."""
    compile_association_once()
    compile_bearings_once()
    with tempfile.TemporaryDirectory() as folder:
        return targets(Path(folder))


def names() -> list[str]:
    """The inputs, in the order of the table."""
    return [*(target.name for target in whole()), ARGUMENTS]


def target_of(seed: int, case: int) -> str:
    """Which input the case is of."""
    return _drawn(seed, case)[1]


def carry_out(seed: int, case: int) -> Tried:
    """Damage an input and take it, in a folder of its own; the same seed and case do the same."""
    rng, name = _drawn(seed, case)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            if name == ARGUMENTS:
                return Tried(name, *give_arguments(rng, Path(folder)))
            target = next(each for each in whole() if each.name == name)
            return Tried(name, *_take(target, rng, Path(folder)))
        except UserError as error:
            return Tried(name, *_refusal(error))
        except Exception as error:  # noqa: BLE001 whatever it is, it is told
            if refused_by_the_machine(error):
                return Tried(name, REFUSED)
            return Tried(name, TRACEBACK, f"{type(error).__name__}: {error} ({_where(error)})"[:300])


def _drawn(seed: int, case: int) -> tuple[np.random.Generator, str]:
    rng = np.random.default_rng([seed, case])
    if rng.integers(ARGUMENTS_OF) == 0:
        return rng, ARGUMENTS
    return rng, str(rng.choice([target.name for target in whole()]))


def _take(target: Target, rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """Damage one of its files, and take them."""
    for name, content in target.files.items():
        (folder / name).write_bytes(content)
    is_sealed = bool(target.sealed) and rng.random() < 0.5
    among: Sequence[Any] = target.sealed if is_sealed else target.mutations
    name = [*target.files][int(rng.integers(len(target.files)))] if target.name != "--set" else "set"
    (folder / name).write_bytes(among[int(rng.integers(len(among)))](target.files[name], rng))
    result = target.take(folder)
    altered = target.claim(folder, result)
    if is_sealed and result != _undamaged(target.name):
        altered = "it is not what it was before it was damaged"
    if isinstance(result, Recording):
        _require_usable(result)
    return (ALTERED, altered) if altered else (ACCEPTED, "")


@cache
def _undamaged(name: str) -> object:
    target = next(each for each in whole() if each.name == name)
    with tempfile.TemporaryDirectory() as folder:
        for file, content in target.files.items():
            (Path(folder) / file).write_bytes(content)
        return target.take(Path(folder))


def _require_usable(recording: Recording) -> None:
    """A filter runs on what was accepted, or says in one line why it cannot."""
    estimate = ekf_slam(recording)
    if not np.isfinite(estimate.poses).all():
        raise ArithmeticError("an accepted recording gives poses that are not finite")


def _refusal(error: UserError) -> tuple[str, str]:
    lines = str(error).split("\n")  # other ends of lines are written out by the command
    is_told = len(lines) == 1 or (isinstance(error, ScenarioError) and lines)
    return (REFUSED, "") if is_told and max(map(len, lines)) < LONGEST else (TRACEBACK, f"not a line: {error!s:.200}")


def _where(error: BaseException) -> str:
    """The innermost line of the project's own that it came through."""
    trace, where = error.__traceback__, ""
    while trace is not None:
        path = Path(trace.tb_frame.f_code.co_filename)
        if "site-packages" not in path.parts and "lib" not in path.parts:
            where = f"{path.name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return where
