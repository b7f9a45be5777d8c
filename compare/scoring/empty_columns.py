"""Why columns of a table are empty, said once below it."""

from __future__ import annotations

from collections.abc import Collection, Iterable

# what columns need (`quantity.Column.needs`), and what is to be said where it is not there
REASONS = {
    "truth": "the truth is not known (no truth.npz)",
    "true poses": "truth.npz has no poses",
    "true landmarks": "truth.npz has no landmarks",
    "true associations": "truth.npz has no associations",
    "covariances": "no estimate has `pose_covs`",
    "late steps": "of a study these begin with the 11th step, and no run has as many",
    "map": "no estimate has landmarks",
    "associations": "no estimate has `association`",
    "nis": "no estimate has `nis` and `nis_dof`",
    "optimum": "no optimum of their kind is there (causal for filtered estimates, batch for smoothed ones)",
    "causal optimum": "causal is not among the estimators that ran",
    "hindsight optimum": "batch is not among the estimators that ran",
    "bound": "no bound could be told",
    "time": "no estimator was run, or tells its time",
}


def empty_lines(empty: Iterable[tuple[str, tuple[str, ...]]], there: Collection[str]) -> list[str]:
    """A line for each reason: titles of the empty columns and what they need, of which only some is `there`."""
    lines: dict[str, list[str]] = {}
    for title, needs in empty:
        missing = next((need for need in needs if need not in there), None)
        if missing is not None:
            lines.setdefault(REASONS[missing], []).append(title)
    return [f"empty: {', '.join(titles)}: {reason}" for reason, titles in lines.items()]
