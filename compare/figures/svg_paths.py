"""An SVG in fewer characters: hundredths of a point, two arcs for an ellipse, and a style said once.

matplotlib draws an ellipse as eight cubic curves, which take seven times as many, and tells every marker and every
member of a collection its style.
"""

from __future__ import annotations

import re

import numpy as np

from slamgauge.arrays import Float

_PATH = re.compile(rb' d="([^"]*)"')
_ELLIPSE = re.compile(rb"M [^A-Za-z]+(?:C [^A-Za-z]+){8}(?:L [^A-Za-z]+)?z\s*")  # eight cubic curves
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_MARKER = re.compile(rb'(<use [^>]*? x=")([^"]*)(" y=")([^"]*)"')
_OF_ONE_STYLE = tuple(  # elements one after the other whose attributes are the same
    re.compile(rb"\s*<" + name + what + rb"(?P<style>" + style + rb")/>(?:\s*<" + name + what + rb"(?P=style)/>)+")
    for name, what, style in (
        (rb"path", rb' d="[^"]*"', rb' clip-path="[^"]*" style="[^"]*"'),
        (rb"use", rb' xlink:href="[^"]*" x="[^"]*" y="[^"]*"', rb' style="[^"]*"'),
    )
)
_DIGITS = re.compile(rb"(\.\d\d)\d+")
VISIBLE = 0.05  # [pt] by which arcs may miss the curves that they stand for


def thinned(svg: bytes) -> bytes:
    """The same picture."""
    svg = _MARKER.sub(_rounded, _PATH.sub(_thinned, svg))
    for run in _OF_ONE_STYLE:
        svg = run.sub(_styled_together, svg)
    return svg


def _rounded(marker: re.Match[bytes]) -> bytes:
    return b'%b%.2f%b%.2f"' % (marker[1], float(marker[2]), marker[3], float(marker[4]))


def _styled_together(members: re.Match[bytes]) -> bytes:
    style = members["style"]
    return b"\n<g" + style + b">" + members[0].replace(style, b"") + b"\n</g>"


def _thinned(path: re.Match[bytes]) -> bytes:
    arcs = _arcs(path[1]) if _ELLIPSE.fullmatch(path[1]) else None
    if arcs is not None:
        return b' d="' + arcs + b'"'
    return b"".join(_DIGITS.sub(rb"\1", line) for line in path[0].splitlines(keepends=True))  # matches take most


def _arcs(curves: bytes) -> bytes | None:
    """Two halves of the ellipse c + p cos t + q sin t that eight curves, from t = 0 on, are taken for.

    None if they are something else.
    """
    numbers = np.array([float(each) for each in _NUMBER.findall(curves)])
    ends: Float = numbers[:50].reshape(25, 2)[::3]  # (9, 2), an eighth of a turn apart
    centre = ends[:8].mean(axis=0)
    p, q = ends[0] - centre, ends[2] - centre
    turn = np.arange(9) * np.pi / 4.0
    if np.abs(centre + np.outer(np.cos(turn), p) + np.outer(np.sin(turn), q) - ends).max() > VISIBLE:
        return None
    axes, (longer, shorter), _ = np.linalg.svd(np.column_stack([p, q]))
    angle = np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))
    arc = f"A {longer:.2f} {shorter:.2f} {angle:.1f} 1 1"
    (x, y), (far_x, far_y) = ends[0], ends[4]
    return f"M {x:.2f} {y:.2f} {arc} {far_x:.2f} {far_y:.2f} {arc} {x:.2f} {y:.2f} z".encode()
