"""The practical's four questions: what each asks, what to look at, and which of its conclusions are put to the test."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from slamgauge.compare.estimators.registry import is_optimum
from slamgauge.compare.report.glossary import ESTIMATOR, TERMS, figure_heads
from slamgauge.compare.report.page_elements import Cell, Head, Table, origin, pictures
from slamgauge.compare.report.plain_page import figure_cell, plain_page
from slamgauge.compare.report.run_page import PICTURES, lead
from slamgauge.compare.scoring.catalogue import columns
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import METRICS, REPORT
from slamgauge.compare.studies.claim_list import CLAIMS


class Question(NamedTuple):
    """A question of the practical.

    Attributes:
        title: what it is about.
        runs: shipped scenarios, in the order in which they are compared, and who is run on each.
        asked: what is varied, and what the practical wants to know.
        look: what to look at in the figures.
        claims: how the ids of its conclusions begin; none are tested of bearings alone.
    """

    title: str
    runs: dict[str, str]
    asked: str
    look: tuple[str, ...]
    claims: str


QUESTIONS = {
    "q1": Question(
        "Known landmarks: the length of the loop, and how many landmarks there are",
        dict.fromkeys(("q1-short-dense", "q1-long-dense", "q1-long-sparse"), "dead-reckoning,ekf,causal,batch"),
        "The filter is told which landmark it sees. The same robot drives a short loop and a long one among many "
        "landmarks, and the long one among few. How do error and uncertainty go, along the loop and when it closes?",
        (
            "The error grows along the loop, where nothing known is seen; dead reckoning goes on like that.",
            "Where the loop closes, landmarks of the start are seen again: error and sigma fall, for the whole map.",
            "With few landmarks there are stretches without any, and less to hold on to when the loop closes.",
            "The filter's error over the optimum's (x optimum) is the price of its linearisation: both see the same.",
        ),
        "q1-",
    ),
    "q2": Question(
        "Unknown landmarks: the gate of the nearest neighbour",
        {
            "q2-long-dense": "ekf,causal,causal@ekf",
            "q2-gate-1": "ekf,causal",
            "q2-gate-100": "ekf,causal,causal@ekf",
        },
        "Nobody says which landmark is seen: an observation is given to the landmark nearest in squared "
        "Mahalanobis distance, if that is below the gate, and begins a new one if not. What do gates of 1, 9, 100 do?",
        (
            "Gate 1 refuses three right observations in five (chi-square, 2 degrees of freedom): doubles fill the map.",
            "Gate 100 refuses nearly nothing: what belongs to one landmark moves another, and that is never undone.",
            "causal receives the true associations, causal@ekf those of the filter: the difference is their cost. "
            "At gate 1 it is left out: an optimum of so many doubles takes very long.",
        ),
        "q2-",
    ),
    "q3": Question(
        "How much noise to assume",
        dict.fromkeys(("q3-scale-0.1", "q3-scale-1", "q3-scale-2", "q3-scale-10"), "ekf,causal"),
        "The filter assumes Q and Py that are 0.1, 1, 2 and 10 times those that are simulated, on the long loop among "
        "few landmarks, whose ids it does not know. Which is best?",
        (
            "Too little noise: the filter is too sure, refuses its own landmarks when it returns, and maps doubles.",
            "Too much: the bounds are wide, NEES falls below 3 and NIS below 1, and wrong landmarks pass the gate.",
            "Innovations tell the noise: with known ids NIS over its degrees of freedom is 1 where it is right. The "
            "nearest is chosen by that very distance, and the gate cuts it off, so that it is below 1 here.",
        ),
        "q3-",
    ),
    "q4": Question(
        "Bearings alone",
        dict.fromkeys(("q4-three-landmarks", "q4-ring"), "ekf,riekf,causal"),
        "The sensor gives directions without distances. A landmark begins as a ray of members, each a Gaussian at "
        "another distance, weighed by every further bearing until one is left (federated information sharing).",
        (
            "A ray loses its members when the robot has moved sideways: without parallax no distance is known.",
            "Members share the information of a bearing by their weights, so that none of it is used twice.",
            "The ellipses of a new landmark are long, along the line of sight, and shrink where sights cross.",
        ),
        "",
    ),
}
CLAIM_HEADS = (
    Head("claim", "its name in claims.json", words=True),
    Head("section", "of the practical", words=True),
    Head("the practical", "its conclusion, in a few words", words=True),
    Head("as a statement about many runs", "what is tested: a ratio of two figures of the same run", words=True),
)
CHIEF = {
    *("ate_m", "final_position_error_m", "nees_pose", "nis_per_dof"),
    *("landmarks_mapped", "wrong_associations", "ratio_to_optimum"),
}


def question_page(folder: Path, name: str) -> str:
    """The page of a question whose scenarios have been run into folders of their names.

    Raises:
        UserError: a run is missing.
    """
    question = QUESTIONS[name]
    runs = {each: read_json(folder / each / METRICS, "run") for each in question.runs}
    found = [each for each in columns("run") if each[1] in CHIEF]
    rows = [
        [Cell(scenario, link=f"{quote(scenario)}/{REPORT}"), Cell(estimator)]
        + [figure_cell(entry.get(key), form) for _, key, form in found]
        for scenario, metrics in runs.items()
        for estimator, entry in metrics["estimators"].items()
    ]
    chief = [head for head in figure_heads("run") if head.title in {title for title, _, _ in found}]
    heads = [Head("scenario", "what was simulated", words=True), ESTIMATOR, *chief]
    claims = [
        [Cell(each.id), Cell(each.section), Cell(each.claim), Cell(each.hypothesis)]
        for each in CLAIMS
        if question.claims and each.id.startswith(question.claims)
    ]
    study = f"slamgauge study {[*question.runs][-1]} --runs 50 --out results/study"
    many = "slamgauge claims --out results/claims" if claims else study
    first = next(iter(runs))
    came = {"scenario": ", ".join(runs), **{key: runs[first].get(key) for key in ("command", "seed", "version")}}
    digests = [(f"Digest of {scenario}", metrics["digest"]) for scenario, metrics in runs.items()]
    return plain_page(
        kind=f"question {name[1:]} of the practical",
        title=question.title,
        lead=[("Asked", question.asked), *(("Look", each) for each in question.look), *said(runs)],
        notes=[
            "a scenario's name in the table leads to its page, with the replay of its run",
            f"one run each, with luck in every figure; many runs tell: {many}",
        ],
        tables=[
            Table("question", "What came out", heads, rows),
            Table("claims", "What the practical concludes, as slamgauge claims tests it", CLAIM_HEADS, claims),
        ],
        pictures=[
            picture._replace(caption=f"{each}. {picture.caption}")
            for each in question.runs
            for picture in pictures(folder / each, PICTURES)
        ],
        glossary=TERMS["run"],
        origin=origin(folder / first / METRICS, came, digests),
    )


def said(runs: dict[str, Any]) -> list[tuple[str, str]]:
    """What each run says of whom it is about, the optima left out: they are what others are held against."""
    return [
        (f"{scenario}, {estimator}", text)
        for scenario, metrics in runs.items()
        for estimator, text in lead(metrics)
        if not is_optimum(estimator)
    ]
