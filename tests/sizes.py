"""Sizes of the test run: `python -m tests quick`, `python -m tests` and `python -m tests full`.

`quick` is for the time while working, the usual size is what CI runs, `full` is for releases. The tables below
list beginnings of test ids.
"""

from __future__ import annotations

import re

SIZES = ("quick", "usual", "full")  # each contains the sizes before it
USUAL = "usual"

NOT_QUICK = (  # these start programs, simulate many runs, or take several seconds
    "tests/benchmarks/",
    "tests/compare/bench/",
    "tests/compare/checks/",
    "tests/compare/cli/",
    "tests/compare/estimators/",
    "tests/compare/figures/test_animation.py",
    "tests/compare/figures/test_for_papers.py",
    "tests/compare/figures/test_ray_strip.py",
    "tests/compare/grading/",
    "tests/compare/noise/",
    "tests/compare/report/",
    "tests/compare/scoring/test_without_truth.py",
    "tests/compare/scoring/test_misleading.py",
    "tests/compare/studies/",
    "tests/ekf/bearings/",
    "tests/ekf/kernels/test_joint_compatibility.py",
    "tests/ekf/test_associating_filter.py",
    "tests/ekf/test_filters_against_textbook.py",
    "tests/ekf/test_robustness.py",
    "tests/graph_baseline/solver/",
    "tests/graph_baseline/test_bearings.py",
    "tests/graph_baseline/test_given_associations.py",
    "tests/graph_baseline/test_gtsam_isam2.py",
    "tests/graph_baseline/test_hard_recordings.py",
    "tests/graph_baseline/test_no_minimum.py",
    "tests/graph_baseline/test_optimum.py",
    "tests/graph_baseline/test_without_gtsam.py",
    "tests/test_",
)

OTHER_SEED = "another seed is in the usual run"
PAGES = "bearings|ci|consistency|exercise|grading|how_many_runs|no_ground_truth|noise|results|your_filter"
FULL = {  # regular expression for the beginning of ids -> why only the full run has these tests
    "tests/benchmarks/test_agreement.py": "references of a benchmark; tests/reference has those of the other tests",
    r"tests/benchmarks/test_benchmarks.py::test_a_benchmark_prints\w+\[(class_of_forms|interruptions)": "many programs",
    r"tests/benchmarks/test_benchmarks.py::test_a_benchmark_prints\w+\[seeded_bugs": "tests/compare/checks has them",
    "tests/benchmarks/test_literature.py::test_every_claim_runs": "ten studies",
    "tests/benchmarks/test_drawn_recordings.py": "long recordings; tests/graph_baseline has scipy and GTSAM",
    r"tests/compare/checks/test_course_files.py::test_seeded_bugs\w+\[(?!dicts from 1)": "one style is usual",
    "tests/compare/checks/test_examination.py::test_a_right_textbook_filter_passes_for_20_seeds": "one seed is usual",
    r"tests/compare/checks/test_examination.py::test_a_seeded_bug_fails_its_check_and_no_other\[[12]-": OTHER_SEED,
    r"tests/compare/checks/test_ignored_inputs.py::test_a_right_filter\w+\[(0.1|10.0)\]": "1.0 is usual",
    "tests/compare/checks/test_ignored_inputs.py::test_bugs_of_a_filter": "bugs of other filters are usual",
    "tests/compare/cli/test_cli.py::test_lost_in_the_woods": "a real recording of 12608 steps",
    "tests/compare/cli/test_cli.py::test_victoria_park": "a real recording of 6968 steps",
    "tests/compare/cli/test_file_names.py": "a program start for each name",
    "tests/compare/cli/test_foreign_files.py::test_files_with_unlucky_names": "many program starts",
    "tests/compare/cli/test_like_windows.py::test_the_main": "most commands, one after the other, without fcntl",
    r"tests/compare/cli/test_lost_places.py::test_a_disk\w+\[older": "interrupted runs keep them in the usual run",
    r"tests/compare/cli/test_lost_places.py::\w+\[new folder-15-143": "SIGINT and SIGHUP are usual",
    r"tests/compare/cli/test_terminal.py::test_closed\w+\[(2>|>/dev/full 2)": "all streams at once are usual",
    r"tests/compare/estimators/test_classes.py::test_right_classes\w+\[(u|R|dist|incr)": "three other styles are usual",
    r"tests/compare/estimators/test_classes.py::test_the_class_of_ntnu_associates_by_itself\[z": "one shape is usual",
    r"tests/compare/estimators/test_isolated_process.py::test_an_endless_external\w+\[True": "with a wall is usual",
    r"tests/compare/estimators/test_octave_course_accuracy.py::\w+\[(?!dicts from 1)": "the styles are the same filter",
    "tests/compare/estimators/test_octave_programs.py": "hundreds of starts of Octave",
    r"tests/compare/estimators/test_wild_steps.py::test_the_error\w+\[(Python|own)": "statistics of six runs",
    r"tests/compare/figures/test_for_papers.py::test_nothing_is_cropped\[page\]": "the narrow sheet is usual",
    "tests/compare/grading/test_gradescope.py::test_the_autograder_gives": "a submission with an error is usual",
    "tests/compare/grading/test_grading.py::test_no_file_of_the_folder": "tests/compare/estimators has this",
    "tests/compare/grading/test_grading.py::test_other_noise": "tests/compare/estimators has the noise of files",
    "tests/compare/noise/test_find_noise.py::test_a_landmark_that_starts_with_an_outlier": "a long recording",
    "tests/compare/noise/test_find_noise.py::test_heavy_tails_without_a_gap_give_student_t": "a long recording",
    r"tests/compare/noise/test_find_noise.py::test_outliers_increase_a_rate_and_not_a_sigma\[0.1\]": "0.02 is usual",
    "tests/compare/scoring/test_error_bounds.py::test_right_runs_fail_as_often": "a statistic of 300 groups of runs",
    "tests/compare/scoring/test_intervals.py::test_95": "a statistic of many samples",
    "tests/compare/scoring/test_misleading.py::test_accepted_outliers_are_in_the_budget": "many runs",
    "tests/compare/scoring/test_optimum_notes.py::test_a_run_of_a_right_filter_is_rarely": "a statistic of many runs",
    "tests/compare/studies/test_budget.py::test_wrong_associations_are_charged": "a filter without ids is usual",
    "tests/compare/studies/test_study.py::test_processes_and_a_dask": "tests/compare/estimators has a cluster",
    "tests/compare/studies/test_twin.py::test_the_twin_of_lost_in_the_woods": "a study of a real recording",
    r"tests/ekf/test_associating_filter.py::test_nearest_neighbour_equals_the_textbook\[1-": OTHER_SEED,
    "tests/ekf/test_associating_filter.py::test_nearest_neighbour_equals_the_textbook_on": "short loops are usual",
    r"tests/ekf/test_filters_against_textbook.py::test_equals_the_textbook\[([a-z-]+-[234]|iekf-1)-": OTHER_SEED,
    r"tests/ekf/test_filters_against_textbook.py::test_full_covariance\w+\[100000": "10 000 updates are usual",
    r"tests/ekf/test_laws.py::test_nis_detects\w+\[[\d.]+-(fej_ekf|oc_ekf|iekf)\]": "ekf and riekf are usual",
    r"tests/ekf/test_robustness.py::test_student_weights_equal_the_textbook\[[a-z-]+-[12]-": OTHER_SEED,
    "tests/ekf/test_robustness.py::test_with_a_gate_the_filter_is_consistent": "a statistic of many runs",
    r"tests/ekf/test_robustness.py::test_student_weights_keep\w+\[0.(0|02)-": "0.1 is usual",
    "tests/graph_baseline/test_bearings.py::test_causal_places_landmarks_in_short_runs": "many runs",
    r"tests/graph_baseline/test_bearings.py::test_the_truth_as_start_leads_to_no_lower_minimum\[[12]\]": OTHER_SEED,
    "tests/graph_baseline/test_optimum.py::test_scipy_finds_no_lower_minimum_from_other_starts": "many descents",
    "tests/graph_baseline/test_without_gtsam.py::test_tests_that_do_not": "a command without GTSAM is usual",
    r"tests/test_checkout.py::\w+\[\.\]": "pip install -e . is usual",
    "tests/test_checkout.py::test_(a_notebook|pytest)": "two other programs in a new clone are usual",
    rf"tests/test_commands_of_pages.py::test_every_command_of_a_page\[({PAGES}).md\]": "tests/compare/cli has these",
    "tests/test_commands_of_pages.py::test_the_cluster_of_a_page": "tests/compare/studies has a study on a cluster",
    "tests/test_examples.py::test_own_estimator$": "the README's commands run it",
    "tests/test_examples.py::test_own_estimator_in_evaluate": "tests/compare/cli has user code in `evaluate`",
    r"tests/test_exercise.py::\w+\[(2.4|ring)": "minutes; the other settings are usual",
    "tests/test_published_benchmark.py": "statistics of a published benchmark",
    "tests/test_question_": "the exercise's figures, statistics of many runs",
}
IN_FULL = re.compile("|".join(FULL))


def size_of(test: str) -> str:
    """Return the smallest size that contains a test, given by its pytest id (`tests/FILE.py::NAME[PARAMETERS]`)."""
    if IN_FULL.match(test):
        return "full"
    return USUAL if test.startswith(NOT_QUICK) else "quick"
