"""Schemas of claims, grades, noise, bench, and of what other commands print."""

from __future__ import annotations

from slamgauge.compare.schemas.json_types import (
    ORIGIN,
    Schema,
    by_name,
    count,
    known,
    number,
    one_of,
    record,
    several,
    text,
    truth,
)


def claims() -> Schema:
    """claims.json."""
    claim = {
        "id": text(),
        "section": text("of the practical"),
        "claim": text("the practical's conclusion, in a few words"),
        "hypothesis": text("the same as a statement about a ratio of two figures of the same run"),
        "effect": known(number("geometric mean of the ratio over runs")),
        "low": known(number("end of its interval, which holds for all claims and after any number of runs")),
        "high": known(number()),
        "p_value": number("that the verdict is wrong, for all claims and after any number of runs"),
        "verdict": one_of(["holds", "does not hold", "undecided"]),
        "optimum": known(number("share of the filter's error that the causal optimum does not have")),
        "optimum_check_share": known(number("share of the runs in which that optimum is in doubt")),
        "runs": count("with both figures"),
        "decidable": known(number("factor from an end of the range that the most runs decide with 90 %")),
        "setting": text("name of the scenario that the ratio is of"),
        "seed": count("from which those of the runs are spawned"),
        "digest": text("of setting and seed: equal digests, equal runs"),
        **ORIGIN,
    }
    return several(record(claim))


def grades() -> Schema:
    """What `slamgauge grade --json` prints."""
    figures = {
        "ate_m": "RMS position error [m], mean over runs",
        "nees_per_dof": "mean pose NEES over 3, from the 11th step on",
        "ratio_to_optimum": "ATE over the causal optimum's",
        "ate_ratio": "ATE over the reference's",
        "nees_ratio": "NEES over the reference's",
        "sigma_position_ratio": "position sigma over the reference's",
        "sigma_heading_ratio": "heading sigma over the reference's",
    }
    rows = {
        f"{key}{end}": known(number(help if not end else ""))
        for key, help in figures.items()
        for end in ("", "_low", "_high")
    }
    grade = {
        "submission": text(),
        "passed": truth(),
        "reason": text("why it has not; empty if it has"),
        "graded": truth("whether there was anything to judge"),
        "callable": text("what of the file is graded"),
        "form": text("how it is called"),
        "kind": one_of(["filtered", "smoothed", ""]),
        "runs": count("that it has done"),
        "failed_laws": text("their names, with spaces between"),
        "seconds_per_run": known(number("median over runs [s]")),
        **rows,
        "scenario": text("its name"),
        "seed": count("from which those of the runs are spawned"),
        "digest": known(text("of scenario and seed: equal digests, equal runs")),
        **ORIGIN,
    }
    return several(record(grade))


def noise() -> Schema:
    """noise.json."""
    ends = {"low": known(number("end of the 95 % interval; null: the log has none")), "high": known(number())}
    sigma = {"sigma": number("the likeliest"), **ends, "assumed": number("by the recording"), "unit": text()}
    outliers = {"rate": number("share of the rows"), **ends, "spread": number("of the outliers, sigma")}
    systematic = {"value": number("the likeliest"), **ends, "unit": text()}
    band = {"low": known(number("of the 95 % band")), "high": known(number()), "rows": count()}
    means = {"before": known(number("with the noise assumed")), "after": known(number("with the noise found"))}
    nis = record({**means, **band})
    quantiles = {
        "normal": several(number(), "of the normal distribution"),
        "before": several(number(), "of the normal scores of innovations, with the noise assumed"),
        "after": several(number(), "with the noise found"),
    }
    correlation = {
        "before": several(number(), "by how many sights of a landmark lie between"),
        "after": several(number()),
        "band": number("that white noise keeps with 95 %"),
    }
    held_out = {"log_likelihood_gain": number("[nats]"), "observations": count("of the second half")}
    return record(
        {
            **ORIGIN,
            "parameters": by_name(record(sigma), "sigmas by name"),
            "outlier_rate": number("share of the observations"),
            "outliers": by_name(record(outliers), "by channel that has any"),
            "student_t_dof": by_name(number(), "degrees of freedom, by channel with heavy tails"),
            "systematic": by_name(record(systematic), "with --systematic"),
            "heading": one_of(["sensor", "odometry"], "whose straight ahead the start's heading is taken for"),
            "nis_by_channel": by_name(nis),
            "nis_by_landmark": by_name(by_name(nis), "by channel and id"),
            "quantiles": by_name(record(quantiles), "by channel"),
            "autocorrelation": by_name(record(correlation), "by channel"),
            "log_likelihood_gain": number("of the noise found over the noise assumed [nats]"),
            "held_out": known(record(held_out, "the gain where nothing was fitted")),
            "sights_counted_as_one": number("of a landmark, because their errors last"),
            "first_sights_left_out": count("that the next ones contradict"),
            "left_without_id": count("observations that find no landmark"),
            "notes": several(text(), "the sentences under the table"),
        },
        optional={"digest": text("SHA-256 of the measurements")},
    )


def bench() -> Schema:
    """bench.json."""
    figures = {
        "mean_observations": number("of a step"),
        "run_s": number("the whole run [s]"),
        "runs_per_second": number(),
        "mean_s": number("of a step [s]"),
    }
    optional = {
        "median_s": number("of the steps of the second round [s]"),
        "p95_s": number("their 95 % quantile [s]"),
        "share_outside_kernels": number("share of the time that is not spent in compiled code"),
        "ratio_to_plain-numpy": number("of medians"),
        "ratio_to_causal": number("of medians"),
    }
    return record(
        {
            **ORIGIN,
            "workload": text(),
            "estimators": by_name(by_name(record(figures, optional=optional)), "by name and number of landmarks"),
            "growth_exponent": by_name(known(number()), "of step time against landmarks; null of a single size"),
        }
    )


def check() -> Schema:
    """What `slamgauge check --json` prints."""
    verdict = {
        "name": text("of the law"),
        "passed": known(truth("null: not judged")),
        "figure": known(number("what is measured")),
        "bound": number("what it may be at most"),
        "blame": text("what is to look at where it is not kept"),
        "limit_of_method": truth("whether the textbook method itself cannot keep it"),
    }
    return several(record(verdict))


def scenarios() -> Schema:
    """What `slamgauge scenarios --json` prints."""
    return several(record({"name": text(), "description": text()}))


def doctor() -> Schema:
    """What `slamgauge doctor --json` prints."""
    return by_name(text(), "what there is, and what of it works")
