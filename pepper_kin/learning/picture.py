"""Pictures of a robot and its surroundings by ray casting in machine code: no display, no browser."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.shading import shade
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.twin.sensors.robot_rays import RobotRays, no_surfaces

SIDE = 320
"""Number of rows and of columns of a picture."""
MOST_DRAWN = 16
"""Maximum number of robots of a batch that are drawn."""
_BASE = "base_footprint"
EYE, AIM = (1.30, 0.95, 1.28), (0.09, 0.07, 0.81)
"""Position and aim point of the camera in the base's axes [m]: it sees head, arms and their goals."""
_ANGLE = np.radians(38.0)  # field of view from edge to edge [rad]
_FINE = 2  # number of rays along either side of a pixel at an edge
_EDGE = 24  # difference of neighboring pixels, of 255, that counts as an edge


class EpisodeCamera:
    """Camera in front of the robot, a little to its left, that moves with the base; for one thread at a time.

    Args:
        pepper: The robot.
        eye: Position of the camera in the base's axes [m], shape (3,).
        aim: Point at which the camera is aimed, in the base's axes [m], shape (3,).
    """

    def __init__(self, pepper: PepperModel, eye: ArrayLike = EYE, aim: ArrayLike = AIM) -> None:
        self._pepper, self._rays = pepper, RobotRays(pepper)
        self._eye = np.array(eye, dtype=float)
        ahead = np.array(aim, dtype=float) - self._eye
        self._coarse = _directions(ahead, 1)
        self._fine = _directions(ahead, _FINE).reshape(SIDE, _FINE, SIDE, _FINE, 3).swapaxes(1, 2)

    def pictures(self, q: Array, scenes: Sequence[Scene]) -> tuple[NDArray[np.uint8], ...]:
        """Return a picture of each robot; robots without a scene share one gray picture.

        Args:
            q: Joint positions [rad or m], shape (N, n).
            scenes: Worlds around the first robots.
        """
        drawn = [self.picture(*pair) for pair in zip(q, scenes, strict=False)]
        return (*drawn, *[np.full((SIDE, SIDE, 3), 128, np.uint8)] * (len(q) - len(drawn)))

    def picture(self, q: Array, scene: Scene) -> NDArray[np.uint8]:
        """Return red, green and blue, 0 to 255, shape (SIDE, SIDE, 3); edges are smooth.

        Args:
            q: Joint positions [rad or m], shape (n,).
            scene: The world around the robot.
        """
        found = self._look(q, scene, self._coarse.reshape(-1, 3)).reshape(SIDE, SIDE, 3)
        levels, edge = found.astype(np.int16), np.zeros((SIDE, SIDE), bool)
        for axis, ends in ((0, (np.s_[1:], np.s_[:-1])), (1, (np.s_[:, 1:], np.s_[:, :-1]))):
            differs = (np.abs(np.diff(levels, axis=axis)) > _EDGE).any(axis=2)
            for end in ends:
                edge[end] |= differs
        fine = self._look(q, scene, self._fine[edge].reshape(-1, 3)).reshape(-1, _FINE**2, 3)
        found[edge] = fine.mean(axis=1).round()
        return found

    def _look(self, q: Array, scene: Scene, directions: Array) -> NDArray[np.uint8]:
        """Return the colors in unit directions, shape (k, 3) both."""
        met, colors = no_surfaces(len(directions)), np.empty(directions.shape, np.uint8)
        base = frame_pose(self._pepper, q, _BASE)
        eye, aims = base[:3, :3] @ self._eye + base[:3, 3], directions @ base[:3, :3].T
        self._rays.look_checked(q, scene, np.tile(eye, (len(directions), 1)), aims, met)
        shade(aims, met, colors)
        return colors


def _directions(line: Array, fine: int) -> Array:
    """Return unit directions of rays around a line, `fine` along a pixel's sides, (rows, columns, 3)."""
    ahead = line / np.linalg.norm(line)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    along = np.tan(_ANGLE / 2) * ((np.arange(SIDE * fine) + 0.5) / (SIDE * fine / 2) - 1.0)
    places = ahead + along[:, None, None] * np.cross(ahead, right) + along[None, :, None] * right
    return np.asarray(places / np.linalg.norm(places, axis=2, keepdims=True))
