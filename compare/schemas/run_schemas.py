"""Schemas of runs and of many of them: the keys of figures, their units and meanings are the catalogue's."""

from __future__ import annotations

from slamgauge.compare.schemas.json_types import (
    ORIGIN,
    Schema,
    by_name,
    count,
    interval,
    known,
    number,
    one_of,
    record,
    several,
    text,
    truth,
)
from slamgauge.compare.scoring.catalogue import CATALOGUE
from slamgauge.compare.scoring.metric import Quantity

RAYS = {
    "members": number("mean over the steps of the number of members in the state"),
    "collapsed": number("rays that became points"),
    "wrong": known(number("of these, those that became the wrong one, or whose landmark is more than 3 sigma off")),
    "off": known(number("those that are more than 3 sigma off")),
    "lost": number("rays that were deleted"),
    "left": number("rays that are rays still"),
}
CLOSURE = {
    "step": count(),
    **{f"{what}_{when}_m": known(number()) for what in ("error", "sigma") for when in ("before", "after")},
}
RELATIVE_ERROR = {
    "distance_m": number("length of the pieces, along the true path [m]"),
    "translation_m": known(number("root mean square error of the motion over a piece [m]")),
    "heading_rad": known(number("of its turn [rad]")),
    "pieces": count("of that length; they overlap"),
}
AXES = "for x, y and heading"
KIND = one_of(["filtered", "smoothed"], "whether a pose knows the past alone, or all measurements")


def metrics() -> Schema:
    """metrics.json."""
    return record(
        {
            **ORIGIN,
            "scenario": known(text("its name; null of a stored recording")),
            "seed": known(count("of the simulation")),
            "digest": text("SHA-256 of the measurements"),
            "truth": truth("whether true poses are known"),
            "estimators": by_name(_score(), "by name"),
            "failures": several(record({"estimator": text(), "error": text()}), "who has no estimate, and why"),
            "notes": several(text(), "the sentences under the table"),
        }
    )


def _score() -> Schema:
    others: dict[str, Schema] = {
        "verdict": known(text("in words (docs/verdicts.md)")),
        "sigma_ratio_to_optimum": known(several(known(number()), length=3)),
        "loop_closure": known(several(record(CLOSURE))),
        "rpe_by_distance": known(several(record(RELATIVE_ERROR))),
    }
    figures = [each for each in CATALOGUE if each.scored and each.key not in ("rays", "kind")]
    fields = {each.key: _told(others.get(each.key, known(number())), each) for each in figures}
    return record({"kind": KIND, **fields}, optional={"rays": record(RAYS, "of bearings alone")})


def summary() -> Schema:
    """summary.json."""
    paired = record(
        {
            "runs": count("with both"),
            "difference": interval("ours less theirs"),
            "ratio": known(interval("ours over theirs")),
            "p_value": known(number("of the paired test of equal means")),
        }
    )
    ratio = record({"of": text(), "over": text(), "mean": number(), "low": known(number()), "high": known(number())})
    precision = {
        "target": number("half-width of intervals, as a share of the ratio"),
        "reached": truth(),
        "look": count("at which it ended, from 1"),
        "looks": count("that were planned"),
        "most_runs": count(),
        "ratios": several(ratio, "of ATEs; their intervals hold at all looks at once"),
    }
    bound = {
        "causal_position_rmse_m": known(number("mean over steps of the root of its mean square over runs [m]")),
        "hindsight_position_rmse_m": known(number("the same given all measurements [m]")),
    }
    return record(
        {
            **ORIGIN,
            "scenario": text("its name"),
            "runs": count(),
            "seed": count("from which those of the runs are spawned"),
            "digest": text("of scenario and seed: equal digests, equal studies"),
            "failures": several(record({"run": count(), "estimator": text(), "error": text()})),
            "estimators": by_name(_entry(), "by name"),
            "against": by_name(by_name(by_name(paired)), "by whom against, by whom, by figure"),
            "precision": known(record(precision, "of a study that went on until its ratios were known")),
        },
        optional={"bound": record(bound, "what no estimator can beat (docs/bound.md), if it was asked for")},
    )


def _entry() -> Schema:
    share = {"level": number("of the band"), "share": number()}
    others: dict[str, Schema] = {
        "nees_share_inside_band": known(record(share)),
        "sigma_ratio_to_optimum_final": known(several(known(number()), length=3)),
        "optimum_check_share": known(number()),
        "seconds_total": record({"mean": known(number())}),
        "verdict": known(text("in words (docs/verdicts.md)")),
        "faults": several(text(), "what the verdict finds wrong, without sizes"),
    }
    figures = [each for each in CATALOGUE if each.over_runs is not None and each.key != "rays"]
    fields = {each.key: _told(others.get(each.key, known(interval())), each) for each in figures}
    named = {"kind": known(KIND), "runs": count("that did not fail")}
    return record({**named, **fields}, optional={"rays": record(RAYS, "means over runs, of bearings alone")})


def sweep() -> Schema:
    """sweep.json."""
    point = {
        "value": text("of the key"),
        "in_doubt": several(text(), "optima that are not what they are taken for"),
        "summary": summary(),
    }
    return record(
        {
            **ORIGIN,
            "scenario": text("its name"),
            "key": text("of the scenario, that is swept"),
            "runs": count("at each value"),
            "seed": count(),
            "points": several(record(point)),
            "faults": by_name(text(), "what is wrong with an estimator, and at which values"),
            "notes": several(text(), "the sentences under the table"),
        }
    )


def budget() -> Schema:
    """budget.json."""
    rung = {
        "name": text(),
        "mse_m2": number("mean squared position error over runs and steps [m^2]"),
        "increment_m2": interval("what it has more than the rung before [m^2]"),
        "optimum_check_share": known(number("share of the runs in which the optimum that it is, is in doubt")),
        "in_doubt": truth("whether the increment rests on an optimum in doubt"),
    }
    return record(
        {
            **ORIGIN,
            "scenario": text("its name"),
            "filter": text("whose error is split"),
            "runs": count(),
            "seed": known(count("from which those of the runs are spawned")),
            "digest": known(text("of scenario and seed: equal digests, equal runs")),
            "rungs": several(record(rung), "from the hindsight optimum to the filter"),
            "costliest": text("the rung above the first that adds most"),
            "chi_square_per_dof": known(interval("of the hindsight optimum")),
            "verdict": text("in words"),
            "notes": several(text(), "the sentences under the table"),
        },
        optional={"rays": record(RAYS, "means over runs, of bearings alone")},
    )


def _told(schema: Schema, quantity: Quantity) -> Schema:
    """A schema with the catalogue's words."""
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    return {**schema, "description": f"{quantity.help}{unit}"}
