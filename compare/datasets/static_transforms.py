"""Static transforms between the frames of a robot, from `/tf_static` of a bag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from slamgauge.arrays import Float
from slamgauge.compare.datasets.bag_file import Bag, frame_of
from slamgauge.compare.storage.trajectories import rotations
from slamgauge.errors import UserError
from slamgauge.se2 import rotation

STATIC = "/tf_static"


class StaticTransforms:
    """A tree of frames: poses (4, 4) of frames in their parents."""

    def __init__(self, bag: Bag, stated: Mapping[str, tuple[float, float, float]], base: str) -> None:
        """Read the transforms of a bag; stated poses (x, y, heading) in the frame `base` replace them."""
        self.where = bag.path
        self.parents: dict[str, tuple[str, Float]] = {}
        if STATIC in bag.topics():
            for _, content in bag.messages(STATIC):
                for each in content.transforms:
                    self.parents[each.child_frame_id.removeprefix("/")] = (frame_of(each), matrix(each.transform))
        for frame, (x, y, heading) in stated.items():
            pose = np.eye(4)
            pose[:2, :2], pose[:2, 3] = rotation(heading), (x, y)
            self.parents[frame] = (base, pose)

    def pose(self, frame: str, base: str) -> Float:
        """Return the pose (4, 4) of a frame in the frame `base`; a frame without a name is `base` itself.

        Raises:
            UserError: static transforms do not connect the frames.
        """
        if frame in ("", base):
            return np.eye(4)
        (root, pose), (root_of_base, pose_of_base) = self._in_root(frame), self._in_root(base)
        if root != root_of_base:
            what = f"no static transform from {frame} to {base} on {STATIC}"
            remedy = f"give its pose with --set transforms.{frame}=[x,y,heading], or another frames.base"
            raise UserError(f"{self.where}: {what}; {remedy}")
        return np.linalg.inv(pose_of_base) @ pose

    def _in_root(self, frame: str) -> tuple[str, Float]:
        """Return the root of a frame's tree, and the pose of the frame in it."""
        pose, visited = np.eye(4), {frame}
        while frame in self.parents:
            frame, step = self.parents[frame]
            pose = step @ pose
            if frame in visited:
                raise UserError(f"{self.where}: the transforms of {STATIC} make a circle at {frame}; correct them")
            visited.add(frame)
        return frame, pose


def matrix(transform: Any) -> Float:
    """Return a `geometry_msgs/Transform` as a matrix (4, 4)."""
    t, q = transform.translation, transform.rotation
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotations(np.array([[q.x, q.y, q.z, q.w]]))[0], (t.x, t.y, t.z)
    return pose
