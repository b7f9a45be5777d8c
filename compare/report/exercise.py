"""Pages of the four questions of the exercise: the task, hints, and the conclusions that claims test."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from slamgauge.compare.estimators.registry import is_optimum
from slamgauge.compare.report.page import plain_page
from slamgauge.compare.report.page_elements import origin, pictures
from slamgauge.compare.report.run_page import PICTURES, lead
from slamgauge.compare.report.table_pages import CLAIM_HEADS
from slamgauge.compare.report.tables import ESTIMATOR, TERMS, Cell, Head, Table, figure_cell, figure_heads
from slamgauge.compare.scoring.catalogue import columns
from slamgauge.compare.storage.files import read_json
from slamgauge.compare.storage.result_files import METRICS, REPORT
from slamgauge.compare.studies.claim_list import CLAIMS


class Question(NamedTuple):
    """A question of the exercise: `runs` are estimators by scenario, `hints` observations to make in the figures.

    `claims` are the first letters of the ids of its claims, empty for question 4, which has none.
    """

    title: str
    runs: dict[str, str]
    task: str
    hints: tuple[str, ...]
    claims: str


QUESTIONS = {
    "q1": Question(
        "Known association: length of the loop and number of landmarks",
        dict.fromkeys(("q1-short-dense", "q1-long-dense", "q1-long-sparse"), "dead-reckoning,ekf,causal,batch"),
        "The association is known. The robot drives a short and a long loop with many landmarks, and a long loop with "
        "few. How do error and uncertainty change along the loop and at the loop closure?",
        (
            "The error grows while only new landmarks are observed; the error of dead reckoning always grows.",
            "At the loop closure the first landmarks are re-observed: error and sigma of the whole map decrease.",
            "With few landmarks parts of the path have no observations, and the loop closure corrects less.",
            "Filter and optimum use the same data: the ratio of their errors (x optimum) shows linearisation errors.",
        ),
        "q1-",
    ),
    "q2": Question(
        "Unknown association: the gate of the nearest neighbour",
        {
            "q2-long-dense": "ekf,causal,causal@ekf",
            "q2-gate-1": "ekf,causal",
            "q2-gate-100": "ekf,causal,causal@ekf",
        },
        "The association is unknown. An observation is assigned to the landmark of smallest squared Mahalanobis "
        "distance if that is below the gate; otherwise it adds a landmark. What is the effect of gates 1, 9 and 100?",
        (
            "Gate 1 rejects 3 of 5 correct associations (chi-square, 2 degrees of freedom): many duplicate landmarks.",
            "Gate 100 rejects almost nothing: wrong associations move landmarks, and the filter cannot undo them.",
            "causal uses the true associations, causal@ekf those of the filter: the difference is the cost of wrong "
            "associations. At gate 1 causal@ekf is not run: with that many duplicates it takes very long.",
        ),
        "q2-",
    ),
    "q3": Question(
        "Assumed noise",
        dict.fromkeys(("q3-scale-0.1", "q3-scale-1", "q3-scale-2", "q3-scale-10"), "ekf,causal"),
        "The filter assumes 0.1, 1, 2 and 10 times the simulated Q and Py, on the long loop with few landmarks and "
        "unknown association. Which factor is best?",
        (
            "Too little: the filter is overconfident, rejects correct associations, and maps duplicate landmarks.",
            "Too much: the bounds are wide, NEES is below 3 and NIS below 1, and wrong associations pass the gate.",
            "With known association NIS over its degrees of freedom is 1 if the noise is right. Here it is below 1, "
            "because the nearest neighbour and the gate select small distances.",
        ),
        "q3-",
    ),
    "q4": Question(
        "Bearing-only SLAM",
        dict.fromkeys(("q4-three-landmarks", "q4-ring"), "ekf,riekf,causal"),
        "The sensor measures bearings without ranges. A new landmark is a ray of members: Gaussians at different "
        "distances. Each bearing changes their weights, until one remains (federated information sharing).",
        (
            "A ray loses members when the robot moves sideways: without parallax the distance is not observable.",
            "The members share the information of a bearing by their weights, so it is used only once.",
            "The ellipse of a new landmark is long in the direction of the bearing; bearings that cross it reduce it.",
        ),
        "",
    ),
}
CHIEF = {
    *("ate_m", "final_position_error_m", "nees_pose", "nis_per_dof"),
    *("landmarks_mapped", "wrong_associations", "ratio_to_optimum"),
}


def question_page(folder: Path, name: str) -> str:
    """Return the page of a question; each of its scenarios has been run into a folder of its name.

    Raises:
        UserError: If a run is missing.
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
    chief = [head for head, column in zip(figure_heads("run"), columns("run"), strict=True) if column in found]
    heads = [Head("scenario", "simulated scenario", words=True), ESTIMATOR, *chief]
    claims = [
        [Cell(each.id), Cell(each.section), Cell(each.claim), Cell(each.hypothesis)]
        for each in CLAIMS
        if question.claims and each.id.startswith(question.claims)
    ]
    sentences = [
        (f"{scenario}, {estimator}", text)
        for scenario, metrics in runs.items()
        for estimator, text in lead(metrics)
        if not is_optimum(estimator)  # optima are the reference
    ]
    study = f"slamgauge study {[*question.runs][-1]} --runs 50 --out results/study"
    many = "slamgauge claims --out results/claims" if claims else study
    first = next(iter(runs))
    provenance = {"scenario": ", ".join(runs), **{key: runs[first].get(key) for key in ("command", "seed", "version")}}
    digests = [(f"Digest of {scenario}", metrics["digest"]) for scenario, metrics in runs.items()]
    return plain_page(
        kind=f"question {name[1:]} of the exercise",
        title=question.title,
        lead=[("Task", question.task), *(("Hint", each) for each in question.hints), *sentences],
        notes=[
            "each scenario in the table links to the page of its run, with a replay",
            f"each result is of a single run and random; compare many runs with: {many}",
        ],
        tables=[
            Table("question", "Results", heads, rows),
            Table("claims", "Conclusions of the exercise, tested by slamgauge claims", CLAIM_HEADS[:4], claims),
        ],
        pictures=[
            picture._replace(caption=f"{each}. {picture.caption}")
            for each in question.runs
            for picture in pictures(folder / each, PICTURES)
        ],
        terms=TERMS["run"],
        origin=origin(provenance, digests),
    )
