"""Results of a submission as `results.json`, the file that Gradescope's autograder reads."""

from __future__ import annotations

from typing import Any

from slamgauge.compare.grading.grades import Grade
from slamgauge.compare.grading.rubric import Item


def gradescope_json(grade: Grade) -> dict[str, Any]:
    """Return the content of results.json; remarks for the teacher are in `extra_data`, which students do not see."""
    mark, trial = grade.mark, grade.trial
    seconds = sum(each["seconds_total"] or 0.0 for each in trial.scores)
    said = [*grade.reasons] or ["No criterion fails."]
    if trial.form:
        said.insert(0, f"Graded is {trial.callable}: {trial.form}.")
    if trial.no_checks:
        said.append(f"The checks do not apply: {trial.no_checks}.")
    return {
        "score": mark.points,
        "max_score": mark.total,
        "execution_time": round(seconds, 3),
        "output": "\n".join(said),
        "output_format": "text",
        "visibility": "visible",
        "stdout_visibility": "hidden",
        "tests": [_test(each) for each in mark.items],
        "extra_data": {"passed": grade.passed, "graded": grade.is_graded, "remarks": [*grade.remarks]},
    }


def _test(item: Item) -> dict[str, Any]:
    """Return an item of the mark as a test; an item that is not judged has no points and no status."""
    test = {
        "name": item.name,
        "score": round(item.points, 2),
        "max_score": round(item.most, 2),
        "output": item.text,
        "visibility": "visible",
    }
    if not item.is_judged:
        return test
    return test | {"status": "passed" if item.points >= item.most else "failed"}
