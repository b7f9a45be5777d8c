"""Valid and invalid estimates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from slamgauge.errors import UserError
from slamgauge.estimate import Estimate
from tests.reference.example_records import estimate


def test_an_estimate_needs_only_kind_and_poses() -> None:
    least = Estimate(kind="smoothed", poses=np.zeros((3, 3)))
    assert (least.landmark_ids.shape, least.landmarks.shape) == ((0,), (0, 2))
    assert least.pose_covs is None
    assert least.association is None


def test_headings_of_an_estimate_are_wrapped() -> None:
    np.testing.assert_allclose(
        estimate(poses=[[0, 0, 7.0], [0, 0, -math.pi], [0, 0, math.pi]]).poses[:, 2],
        [7 - 2 * math.pi, math.pi, math.pi],
    )


def test_figures_of_an_optimum_are_plain_numbers() -> None:
    optimum = estimate(chi_square=np.float64(12.5), chi_square_dof=np.array(10), optimum_check=np.float64("inf"))
    assert (type(optimum.chi_square), type(optimum.chi_square_dof), type(optimum.optimum_check)) == (float, int, float)
    assert optimum == estimate(chi_square=12.5, chi_square_dof=10, optimum_check=math.inf)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"optimum_check": -0.1}, "optimum_check: -0.1 does not fit; give a number >= 0, or None"),
        ({"optimum_check": math.nan}, "optimum_check: nan does not fit; give a number >= 0, or None"),
        ({"optimum_check": "far"}, "optimum_check: not an array of numbers; .*"),
        ({"optimum_check": [0.1, 0.2]}, r"optimum_check: shape \(2,\) does not fit; .*"),
        ({"chi_square": math.inf, "chi_square_dof": 4}, "chi_square: inf does not fit; give a number >= 0, or None"),
        ({"chi_square": 1.0, "chi_square_dof": 4.5}, "chi_square_dof: 4.5 does not fit; give a whole number >= 0, .*"),
        ({"chi_square": 1.0}, "chi_square: give chi_square and chi_square_dof together, or neither"),
    ],
)
def test_invalid_figures_of_an_optimum_are_refused(figures: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=f"^{message}$"):
        estimate(**figures)
