"""The refusal of user code that has none of the forms: what it has, what is missing, and the wrapper to copy."""

from __future__ import annotations

WRAPPER = """from {module} import {name}


class Wrapper:  # comments: what slamgauge gives and reads
    def __init__(self, prior_mean, prior_cov):  # (3,) x, y [m], heading [rad]; (3, 3)
        self.filter = {name}(...)  # and let it start at prior_mean and prior_cov

    def predict(self, increment, cov):  # (3,) dx, dy [m], dtheta [rad] in the robot's frame; its noise (3, 3)
        self.filter.predict(...)

    def update(self, ids, values, covs):  # (m,); (m, 2) range [m], bearing [rad]; (m, 2, 2)
        for name, z, R in zip(ids, values, covs):
            self.filter.update(...)

    pose = property(lambda self: self.filter.x[:3])
    pose_cov = property(lambda self: self.filter.P[:3, :3])
    landmark_ids = property(lambda self: list(self.filter.index))
    landmarks = property(lambda self: self.filter.x[3:].reshape(-1, 2))
"""
FUNCTIONS = {  # lines of a wrapper of functions instead of those of a class
    "import {name}": "import predict, update  # their names",
    "self.filter = {name}(...)  # and let it start at prior_mean and prior_cov": (
        "self.x, self.P = prior_mean, prior_cov"
    ),
    "self.filter.predict(": "self.x, self.P = predict(self.x, self.P, ",
    "self.filter.update(": "self.x, self.P = update(self.x, self.P, ",
    "self.filter.": "self.",
}
PAGE = "docs/your_filter.md"


def refusal(text: str, has_and_lacks: str, module: str, name: str) -> str:
    """Return the lines of a refusal.

    Args:
        text: address of the code.
        has_and_lacks: what it has and what is missing, of two parts with `; it lacks ` between them.
        module: name of its module.
        name: name of its class or function; empty if it has none.
    """
    has, _, lacks = has_and_lacks.partition("; it lacks ")
    wrapper = WRAPPER
    for of_class, of_functions in FUNCTIONS.items() if not has.startswith("class ") else []:
        wrapper = wrapper.replace(of_class, of_functions)
    wrapper = wrapper.format(module=module, name=name or "Filter")
    remedy = f"copy this wrapper into another file, fill in the dots, and give FILE.py:Wrapper ({PAGE})"
    return f"estimator {text}: {has}\nit lacks {lacks}\n{remedy}:\n\n{wrapper}"


def shortened(error: Exception) -> str:
    """Return an error in one line; a refusal without its wrapper."""
    lines = str(error).split("\n")
    return lines[0] if len(lines) < 3 else f"{lines[0]}; {lines[1]}; hand in a wrapper ({PAGE})"
