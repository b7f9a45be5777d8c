"""Every schema by its name."""

from __future__ import annotations

from slamgauge.compare.schemas.command_schemas import bench, check, claims, doctor, grades, noise, scenarios
from slamgauge.compare.schemas.json_types import document
from slamgauge.compare.schemas.run_schemas import budget, metrics, summary, sweep

SCHEMAS = {
    "metrics": document("metrics.json", "a run, by `run` and `evaluate`", metrics()),
    "summary": document("summary.json", "a study, by `study`", summary()),
    "sweep": document("sweep.json", "studies over the values of a key, by `study --sweep`", sweep()),
    "budget": document("budget.json", "an error budget, by `budget`", budget()),
    "claims": document("claims.json", "the practical's conclusions, tested, by `claims`", claims()),
    "grades": document("grades", "a row for each submission, by `grade --json`", grades()),
    "noise": document("noise.json", "the noise that a recording supports, by `noise`", noise()),
    "bench": document("bench.json", "step times, by `bench`", bench()),
    "check": document("laws", "whether a filter keeps them, by `check --json`", check()),
    "scenarios": document("scenarios", "those that are shipped, by `scenarios --json`", scenarios()),
    "doctor": document("doctor", "what works, by `doctor --json`", doctor()),
}
