"""The EKF in every setting of the exercise, compared with the causal optimum: its error, and the sigma that it claims.

The bounds are two-sided: an EKF that became better than it is has another setting, or sees more than it should. They
are the mean over 100 runs of another root seed, plus and minus four standard errors of the mean of RUNS runs.
Logarithms are compared, because ratios of diverged runs are skewed. The table comes from the stored runs of the first
command, and the second command prints it:

    slamgauge exercise --runs 100 --seed 100 --out results/exercise-100
    python -m tests.test_exercise results/exercise-100

It also prints the share of samples of RUNS runs, drawn from the 100, whose mean is outside: at most 0.5 % for a bound,
and 3 % for any of the 30.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from slamgauge.arrays import Float
from slamgauge.compare.exercise.results import run_setting
from slamgauge.compare.exercise.settings import CAUSAL, EKF, SETTINGS
from slamgauge.compare.scoring.runs import paired
from tests.marks import in_full

pytestmark = pytest.mark.slow

RUNS, SEED = 4, 7
ROOT_SEED_OF_TABLE, RUNS_OF_TABLE = 100, 100
STANDARD_ERRORS = 4.0
TABLE = {  # mean and standard deviation over runs of the logarithms of EKF / causal optimum: ATE, RMS of claimed sigma
    "1.1": (0.0241, 0.3636, 0.1915, 0.0354),
    "2.1": (0.0577, 0.3352, -0.0832, 0.0087),
    "2.2": (0.2472, 0.5390, -0.2853, 0.0180),
    "2.3": (-0.0024, 0.0440, -0.0037, 0.0019),
    "2.4": (1.7038, 0.6805, -0.1845, 0.0161),
    "2.5": (2.5064, 0.9075, -0.4484, 0.0159),
    "2.6": (0.1826, 0.3589, -0.1014, 0.0078),
    "2.7": (0.4929, 0.5481, -0.3336, 0.0172),
    "2.8": (0.1521, 0.3639, -0.0043, 0.0038),
    "3.1": (0.6090, 0.4056, -0.9766, 0.0153),
    "3.2": (0.1521, 0.3639, -0.0043, 0.0038),
    "3.3": (0.0732, 0.2941, 1.1259, 0.0026),
    "3.4": (0.1036, 0.3573, 0.3313, 0.0024),
    "4.1": (0.1730, 0.3905, -0.0554, 0.0252),
    "ring": (0.2030, 0.3922, -0.1953, 0.0154),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of stores: settings with the same measurements share the optimum."""
    return tmp_path_factory.mktemp("exercise")


LONG = ("2.4", "ring")  # minutes
SIMILAR = ("2.1", "2.6", "2.7", "2.8", "3.2", "3.4")  # the usual size has settings of every question


@pytest.mark.parametrize(
    "figure", [*(each for each in SETTINGS if each not in LONG + SIMILAR), *in_full(LONG + SIMILAR)]
)
def test_error_and_sigma_of_the_ekf_against_the_optimum(figure: str, folder: Path):
    ratios = log_ratios(figure, folder, SEED, RUNS)
    for name, logs, mean, deviation in zip(
        ("ATE", "sigma"), ratios, TABLE[figure][::2], TABLE[figure][1::2], strict=True
    ):
        assert len(logs) == RUNS
        assert abs(logs.mean() - mean) < STANDARD_ERRORS * deviation / RUNS**0.5, f"{name}: {np.exp(logs)}"


def log_ratios(figure: str, folder: Path, seed: int, runs: int) -> tuple[Float, Float]:
    """Run a setting; return the logarithms (runs,) of EKF / causal optimum, of the ATE and of the claimed sigma."""
    with ThreadPoolExecutor(1) as executor:
        found = run_setting(SETTINGS[figure], (EKF, CAUSAL), runs, seed, folder, executor).study.loaded
    rows, others = paired(found[EKF], found[CAUSAL])
    errors = found[EKF].figures["ate_m"][rows] / found[CAUSAL].figures["ate_m"][others]
    sigmas = found[EKF].reported_sigma()[rows] / found[CAUSAL].reported_sigma()[others]
    return np.log(errors), np.log(sigmas)


def main(folder: Path) -> None:
    """Print the table, and the shares of samples outside the bounds."""
    rng = np.random.default_rng(0)
    for figure in SETTINGS:
        every = log_ratios(figure, folder, ROOT_SEED_OF_TABLE, RUNS_OF_TABLE)
        row = [figure_of(logs) for logs in every for figure_of in (np.mean, lambda logs: logs.std(ddof=1))]
        outside = [
            np.mean(
                np.abs(logs[rng.integers(0, len(logs), (100_000, RUNS))].mean(axis=1) - logs.mean())
                > STANDARD_ERRORS * logs.std(ddof=1) / RUNS**0.5
            )
            for logs in every
        ]
        values, shares = ", ".join(f"{each:.4f}" for each in row), " ".join(f"{each:.2%}" for each in outside)
        print(f'    "{figure}": ({values}),  # outside {shares}')


if __name__ == "__main__":
    main(Path(sys.argv[1]))
