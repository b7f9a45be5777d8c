"""Constructors of user classes: arguments by parameter name, and noise that changes from step to step.

A class may store the noise that it receives as an attribute of any name. `Noise` finds these attributes by their value
after construction, and sets them to the noise of each step and scan.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.estimators.forms.signatures import parameters
from slamgauge.compare.estimators.user_code import Callee, UserCodeError

ROLES = {
    "mean": "x0 mu0 initial_state init_state initial_pose init_pose pose0 start_pose start prior_mean init_mu init_x "
    "initial_mean init_mean x_init mu_init xEst mu x state pose mean",
    "cov": "P0 Sigma0 sigma0 initial_cov initial_covariance init_cov init_covariance prior_cov init_P init_Sigma "
    "initial_P P_init Sigma_init PEst P Sigma sigma cov covariance cov0",
    "motion": "Q motion_noise process_noise control_noise Q_u motion_cov process_cov motion_covariance "
    "process_covariance process_noise_cov motion_noise_cov odometry_cov",
    "measurement": "R measurement_noise sensor_noise observation_noise meas_noise R_z measurement_cov observation_cov "
    "measurement_covariance sensor_cov measurement_noise_cov",
    "count": "n_landmarks num_landmarks N n landmark_count max_landmarks nLandmarks number_of_landmarks N_landmarks "
    "n_lm num_lm numLandmarks M L n_features",
    "dt": "dt DT delta_t time_step timestep Ts",
    "sensor": "sensor",
    "x": "start_x init_x0 x_start",
    "y": "start_y y0 init_y0 y_start",
    "theta": "start_theta theta0 yaw0 start_yaw theta_start",
    "alphas": "alphas alpha",
    "own association": "do_asso do_association",
    "offset": "sensor_offset",
}
ROLE_OF = {name: role for role, names in ROLES.items() for name in names.split()}
LETTERS = {"Q", "R"}  # courses disagree on which one is the noise of the motion


def roles_of(kind: Callee, known: set[str]) -> dict[str, str]:
    """Return the role of each constructor parameter that is in `known`, by parameter name.

    Raises:
        UserCodeError: a parameter without default has no known role.
    """
    given = parameters(kind)
    names = [each.name for each in given]
    roles = {name: ROLE_OF[name] for name in names if ROLE_OF.get(name) in known}
    if "y0" in names and "x0" in names:
        roles["x0"] = "x"
    lacking = [each.name for each in given if each.name not in roles and each.default is each.empty]
    if lacking:
        usual = ", ".join(ROLES[role].split()[0] for role in ROLES if role in known)
        what = f"its constructor needs {', '.join(lacking)}, which no recording has under these names"
        raise UserCodeError(f"{what}; give defaults, or use the usual names, for example {usual}")
    return roles


def constructed(kind: Callee, roles: dict[str, str], values: dict[str, Any]) -> Any:
    """Return a new object of the class; arrays are copied."""
    return kind(
        **{name: np.array(v) if isinstance(v := values[role], np.ndarray) else v for name, role in roles.items()}
    )


class Noise:
    """Attributes of an object that contain noise covariances.

    Args:
        slam: the new object.
        passed: covariances that its constructor received, by role (`motion`, `measurement`).
        shapes: sizes that attributes of the usual names must have if the constructor does not receive that role.
    """

    def __init__(self, slam: Any, passed: dict[str, Float], shapes: dict[str, tuple[int, ...]]) -> None:
        self._slam = slam
        self.names: dict[str, list[str]] = {}
        self.replaced: dict[str, Float] = {}
        for role, shape in shapes.items():
            self.names[role] = [
                name
                for name, value in vars(slam).items()
                if np.shape(value) == shape
                and (np.array_equal(value, passed[role]) if role in passed else ROLE_OF.get(name) == role)
            ]
            if role not in passed:
                self.replaced |= {name: np.array(vars(slam)[name]) for name in self.names[role]}

    def set(self, role: str, cov: Float) -> None:
        """Set all attributes of a role."""
        for name in self.names.get(role, ()):
            object.__setattr__(self._slam, name, cov.copy())  # a dataclass may be frozen
