"""What is wrong with odometry: noise, which estimators are told of, and errors that they are not told of."""

from __future__ import annotations

import numpy as np
from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from slamgauge.arrays import Float
from slamgauge.compare.scenarios.csv_tables import Table, TableText, covariances
from slamgauge.compare.scenarios.section import NonNegative, Probability, Section
from slamgauge.compare.scenarios.settings_sections import Number
from slamgauge.compare.storage.csv_folder import POSE_COV

COV_HEADER = ("step", *POSE_COV)


class Motion(Section):
    """Odometry noise, and what is wrong with odometry beside it.

    Noise has the standard deviations `sigma_speed` [m/s] and `sigma_yaw_rate_deg` [deg/s] of each step; or every step
    has a covariance of its own, in the body frame [m, m, rad]: a row of the file `covariances`.

    Odometry reads every way longer by the share `scale_error`, and turns too far to the left by `turn_bias_per_metre`
    [rad/m]. In a step the wheels slip with probability `slip_rate`: odometry then reads a way that is longer by a share
    between 0 and 1, uniformly.
    """

    covariances: Table | None = None
    sigma_speed: NonNegative | None = Field(default=None, validate_default=True)
    sigma_yaw_rate_deg: NonNegative | None = Field(default=None, validate_default=True)
    slip_rate: Probability = 0.0
    scale_error: Number = 0.0
    turn_bias_per_metre: Number = 0.0

    @field_validator("covariances")
    @classmethod
    def _are_covariances(cls, table: TableText | None) -> TableText | None:
        if table is not None and not np.array_equal(table.rows(COV_HEADER)[:, 0], np.arange(1, len(covs(table)) + 1)):
            text = "{name}: steps must be 1, 2, 3 and so on; sort the rows"
            raise PydanticCustomError("table", text, {"name": table.name})
        return table

    @field_validator("sigma_speed", "sigma_yaw_rate_deg")
    @classmethod
    def _one_form(cls, value: float | None, info: ValidationInfo) -> float | None:
        if "covariances" not in info.data:
            return value
        has_table = info.data["covariances"] is not None
        if value is None and not has_table:
            raise PydanticCustomError("missing", "missing; add it")
        if value is not None and has_table:
            raise PydanticCustomError("foreign", "motion.covariances has the noise already; remove one of them")
        return value

    def sigmas(self, duration: Float) -> Float:
        """Standard deviations (3,), or (N, 3) [m, m, rad] of increments of this duration, (), or (N, 1) [s]."""
        assert self.sigma_speed is not None and self.sigma_yaw_rate_deg is not None
        return duration * np.array([self.sigma_speed, 0.0, np.deg2rad(self.sigma_yaw_rate_deg)])

    def misread(self, command: Float, slips: Float, shares: Float) -> Float:
        """What odometry without noise makes of increments (N, 3), for uniform draws (N,) of slips and their shares."""
        if not (self.slip_rate or self.scale_error or self.turn_bias_per_metre):
            return command
        way = np.linalg.norm(command[:, :2], axis=1)
        longer = (1.0 + self.scale_error) * (1.0 + np.where(slips < self.slip_rate, shares, 0.0))
        turn = command[:, 2] + self.turn_bias_per_metre * way
        return np.column_stack([command[:, :2] * longer[:, None], turn])


def covs(table: TableText) -> Float:
    """Covariances (N, 3, 3) [m, m, rad] of the file's steps 1..N."""
    return covariances(table, COV_HEADER, 3)
