"""Names of the Octave course's functions in Python, and the file that holds the second of them. No code runs."""

from __future__ import annotations

import ast
from pathlib import Path

from slamgauge.compare.estimators.syntax_tree import parsed, read_source

PREDICTIONS = ("prediction_step", "prediction", "predict_step", "predict", "predictionStep", "predictStep")
CORRECTIONS = ("correction_step", "correction", "correct_step", "correct", "correctionStep", "correctStep")
OTHER_FORM = "update"  # partner of a `predict` that belongs to another form


def partner_file(file: Path) -> Path | None:
    """Return the neighbour that defines the second function, if a file has only one and one neighbour has the other.

    If several neighbours define it, a file named as the function counts.

    Raises:
        UserError: a file is too large.
        OSError: a file cannot be read.
    """
    own = _functions(file)
    wanted = [other for mine, other in ((PREDICTIONS, CORRECTIONS), (CORRECTIONS, PREDICTIONS)) if own & {*mine}]
    if len(wanted) != 1 or OTHER_FORM in own:
        return None
    others = [each for each in sorted(file.parent.glob("*.py")) if each.name != file.name and each.is_file()]
    found = [each for each in others if _functions(each) & {*wanted[0]}]
    named = [each for each in found if each.stem in wanted[0]]
    return (named or found)[0] if len(named or found) == 1 else None


def _functions(file: Path) -> set[str]:
    """Return the names that a file defines as functions or imports."""
    body = parsed(read_source(file)).body
    defined = {node.name for node in body if isinstance(node, ast.FunctionDef)}
    imported = {alias.asname or alias.name for node in body if isinstance(node, ast.ImportFrom) for alias in node.names}
    return defined | imported
