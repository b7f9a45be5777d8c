"""Results of comparing an estimator with its reference, tolerances (bars), and the file that keeps results."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from slamgauge.recording import Recording

Verdict = Literal["agrees", "worse", "failed", "undecided", "not compared"]

FILTER_BAR = 1e-6  # sigma
COST_BAR = 1e-6  # relative, and absolute below a cost of 1
STEP_BAR = 0.02  # sigma
ROOT = Path(__file__).parents[2]
CODE = ("core", "ekf", "graph_baseline", "benchmarks/references", "tests/reference")


@dataclass(frozen=True)
class Outcome:
    """Result of an estimator on a recording.

    Attributes:
        estimator: its name.
        verdict: `undecided` if no reference has an answer, `not compared` if no reference for such recordings exists.
        difference: to the reference; sigmas for filters and `causal` (its worst step), relative cost for `batch`.
        note: more about the result, for example the error message.
        steps: number of steps compared one by one (`causal` only).
        steps_off: number of these steps with a difference above the bar.
        unflagged: the same number if the estimate's own check did not report a problem, otherwise 0.
    """

    estimator: str
    verdict: Verdict
    difference: float = 0.0
    note: str = ""
    steps: int = 0
    steps_off: int = 0
    unflagged: int = 0


@dataclass(frozen=True)
class Judged:
    """All outcomes of a recording, and the seconds that they took."""

    seed: int
    number: int
    steps: int
    tags: tuple[str, ...]
    outcomes: list[Outcome]
    seconds: float


def attempt(estimator: Callable[[Recording], Estimate], recording: Recording) -> Estimate | str:
    """Return the estimate, or the error message of a `UserError` or of an exception that should have been one."""
    try:
        return estimator(recording)
    except UserError as error:
        return str(error)
    except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


# --- file of results: a line each, the digest of the code and JSON -----------------------------------


def keep_result(path: Path, judged: Judged) -> None:
    """Append the results of a recording to a file."""
    with path.open("a") as file:  # the line may follow one that an interrupt cut short
        file.write(f"\n{code_digest()} {json.dumps(asdict(judged))}")


def kept_results(path: Path, seed: int) -> list[Judged]:
    """Return the results in a file that the present code computed with this seed; incomplete lines are skipped."""
    found: list[Judged] = []
    for line in path.read_text().splitlines() if path.exists() else ():
        digest, _, text = line.partition(" ")
        with suppress(json.JSONDecodeError):
            content: dict[str, Any] = json.loads(text)
            if digest == code_digest() and content["seed"] == seed:
                content["outcomes"] = [Outcome(**each) for each in content["outcomes"]]
                content["tags"] = tuple(content["tags"])
                found.append(Judged(**content))
    return found


@cache
def code_digest() -> str:
    """Return the digest of all code that the results depend on."""
    digest = hashlib.sha256()
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()
