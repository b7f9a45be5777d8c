"""Remarks for the teacher's eye: imports of slamgauge's estimators or of other submissions, and identical figures.

They change neither marks nor verdicts: a teacher decides.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence

from slamgauge.compare.estimators.sources import Sources
from slamgauge.compare.estimators.syntax_tree import parsed
from slamgauge.compare.scoring.scores import Score

PACKAGE = "slamgauge"
# parts of slamgauge that a submission needs, or that are mathematics only
ALLOWED = {
    *("Estimate", "Estimator", "Kind", "MapHistory", "RayLog", "Recording", "Observations", "OnlineFilter"),
    *("adapters", "se2", "arrays", "errors", "estimate", "recording", "sensors", "sensor_models", "version"),
    *("between", "chain", "compose", "rotation", "wrap", "OBSERVATION_DIM", "Sensor", "Float", "Int", "Marks"),
    *("triangulation", "Triangulation", "triangulate", "UserError", "__version__"),
}
ADAPTERS = f"{PACKAGE}.compare.estimators.adapters"


def source_remarks(sources: Sources | None, others: Collection[str] = ()) -> list[str]:
    """Return a remark if a submission uses estimators or the simulator of slamgauge, or other submissions.

    No code runs.

    Args:
        sources: its sources.
        others: names of the modules in its folder that are submissions.
    """
    if sources is None:
        return []
    found: list[str] = []
    for path, content in sources.files:
        found += [name for name in _used(parsed(content)) if not _is_allowed(name)]
        head = path.partition("/")[0].removesuffix(".py")
        found += [f"the submission {head}"] if head in others and head != sources.module else []
    names = ", ".join(dict.fromkeys(found))
    return [f"uses {names}" if len(names) < 200 else f"uses {names[:200]} ..."] if names else []


def _used(tree: ast.AST) -> Iterator[str]:
    """Yield the full names of slamgauge that a source imports, reads as attributes, or writes as texts of imports."""
    aliases: dict[str, str] = {}
    nodes = [*ast.walk(tree)]
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module and not node.level and _is_ours(node.module):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if _is_ours(alias.name):
                    aliases[alias.asname or PACKAGE] = alias.name if alias.asname else PACKAGE
                    if alias.name != PACKAGE:
                        yield alias.name
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in aliases:
            yield f"{aliases[node.value.id]}.{node.attr}"
        elif isinstance(node, ast.Call):
            texts = (each.value for each in node.args if isinstance(each, ast.Constant))
            yield from (f"{text} (as a text)" for text in texts if isinstance(text, str) and _is_ours(text))


def _is_ours(module: str) -> bool:
    return module == PACKAGE or module.startswith(f"{PACKAGE}.")


def _is_allowed(name: str) -> bool:
    return name == PACKAGE or name.split(".")[1] in ALLOWED or f"{name}.".startswith(f"{ADAPTERS}.")


def figure_remarks(runs: Mapping[str, Sequence[Score]], reference: str) -> dict[str, list[str]]:
    """Return remarks on submissions whose errors are identical, to the last bit, in every run.

    Args:
        runs: scores of each run, by name of the submission, and those of the reference by its name.
        reference: name of the reference.
    """
    alike: dict[tuple[float | None, ...], list[str]] = defaultdict(list)
    for name, scores in runs.items():
        if scores:
            alike[tuple(each["ate_m"] for each in scores)].append(name)
    remarks: dict[str, list[str]] = {}
    for names in alike.values():
        for name in names:
            others = [f"the reference {each}" if each == reference else each for each in names if each != name]
            if others:
                remarks[name] = [f"same figures as {', '.join(others)}"]
    return remarks
