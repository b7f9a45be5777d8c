"""What user code imports and this system lacks: drawing libraries, names of older numpy, helpers of PythonRobotics."""

from __future__ import annotations

import ast
import threading
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from functools import partial
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.se2 import rotation

DRAWING = {
    *("IPython", "PIL", "PyQt5", "PyQt6", "PySide2", "PySide6", "bokeh", "celluloid", "cv2", "imageio", "mayavi"),
    *("moviepy", "plotly", "pygame", "pyqtgraph", "seaborn", "tkinter", "turtle", "visdom", "vispy", "vpython"),
    *("OpenGL", "altair", "arcade", "matplotlib", "mpl_toolkits", "open3d", "pyglet", "pylab", "scienceplots", "wx"),
}
PROGRESS = {"tqdm", "progressbar", "alive_progress"}  # `tqdm(range(9))` is `range(9)`
OLD_NUMPY: dict[str, object] = {
    "Inf": np.inf,
    "Infinity": np.inf,
    "infty": np.inf,
    "NaN": np.nan,
    "NAN": np.nan,
    "float": float,
    "int": int,
    "bool": bool,
    "object": object,
    "complex": complex,
    "float_": np.float64,
    "complex_": np.complex128,
    "str": str,
    "PINF": np.inf,
    "NINF": -np.inf,
    "cumproduct": np.cumprod,
    "round_": np.round,
    "asfarray": partial(np.asarray, dtype=np.float64),
    "mat": np.asmatrix,
    "row_stack": np.vstack,
    "product": np.prod,
    "alltrue": np.all,
    "sometrue": np.any,
    "in1d": np.isin,
}
_lock = threading.Lock()
_users: Counter[str] = Counter()  # contexts that need a name of numpy


def old_numpy_names(tree: ast.Module) -> list[str]:
    """Return the names of `OLD_NUMPY` that a module uses and that numpy no longer has."""
    used: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("np", "numpy"):
            used.add(node.attr)
        elif isinstance(node, ast.ImportFrom) and node.module == "numpy":
            used |= {alias.name for alias in node.names}
    return sorted(name for name in used & {*OLD_NUMPY} if _users[name] or name not in vars(np))


@contextmanager
def supplied(names: Sequence[str]) -> Generator[None]:
    """Supply names of older numpy inside the context; the last thread that leaves removes a name."""
    with _lock:
        missing = [name for name in names if _users[name] or name not in vars(np)]
        for name in missing:
            _users[name] += 1
            setattr(np, name, OLD_NUMPY[name])
    try:
        yield
    finally:
        with _lock:
            for name in missing:
                _users[name] -= 1
                if not _users[name]:
                    delattr(np, name)


class _Nothing:
    """An object whose attributes, calls and items do nothing."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return self

    def __init__(self, *, is_progress: bool = False) -> None:
        self._is_progress = is_progress

    def __call__(self, *given: object, **_: object) -> Any:
        """Return the function that it decorates, or what a progress bar counts; otherwise itself."""
        if given and (self._is_progress or (len(given) == 1 and isinstance(given[0], FunctionType))):
            return given[0]
        return self

    def __mro_entries__(self, _: object) -> tuple[()]:
        """A class of the user that inherits from the library inherits from nothing."""
        return ()

    def __getitem__(self, _: object) -> Any:
        return self

    def __iter__(self) -> Any:
        return iter(())

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        return None


class _Stub(ModuleType):
    """A module whose attributes do nothing."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Nothing(is_progress=self.__name__ in PROGRESS)

    def __call__(self, *given: object, **_: object) -> Any:
        return _Nothing(is_progress=self.__name__ in PROGRESS)(*given)


def stand_in(name: str) -> tuple[ModuleType, str] | None:
    """Return a stand-in for a missing module and a sentence about it; None for any other module."""
    top = name.partition(".")[0]
    if top in DRAWING | PROGRESS:
        return _Stub(top), f"{top} is not installed: what it would draw is left out"
    if name == "utils.plot":
        return _stub_package(name), "utils.plot is not found: what it would draw is left out"
    if name == "utils.angle":
        module = _stub_package(name)
        vars(module.angle).update(angle_mod=angle_mod, rot_mat_2d=rot_mat_2d)
        return module, "utils.angle is not found: angle_mod and rot_mat_2d of slamgauge stand in for it"
    return None


def _stub_package(name: str) -> ModuleType:
    package, _, part = name.partition(".")
    module = _Stub(package)
    setattr(module, part, _Stub(name))
    return module


def angle_mod(x: float | Float, zero_2_2pi: bool = False, degree: bool = False) -> float | Float:
    """Return an angle in [-pi, pi), or in [0, 2 pi) if `zero_2_2pi`; in degrees if `degree`."""
    angle = np.deg2rad(x) if degree else np.asarray(x, dtype=np.float64)
    turned = angle % (2.0 * np.pi) if zero_2_2pi else (angle + np.pi) % (2.0 * np.pi) - np.pi
    found = np.rad2deg(turned) if degree else turned
    return float(found) if np.isscalar(x) else found


def rot_mat_2d(angle: float) -> Float:
    """Return the rotation matrix (2, 2) of an angle [rad]."""
    return rotation(angle)
