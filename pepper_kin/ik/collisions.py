"""Collisions as the inverse kinematics sees them: a verdict, and half-spaces that keep steps clear."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.ik.solvers.step_solver import HalfSpaces
from pepper_kin.ik.tasks.task import Array
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

# Steps keep this distance where they can [m], and take notice of bodies nearer than the second number.
MARGIN = 0.005
NOTICE = 0.10

# Half-spaces remembered in one descent; the oldest is forgotten first.
CUTS = 4


class Collisions:
    """Answers for one robot in one scene, or in none (then nothing ever collides).

    Args:
        pepper: The robot.
        scene: The world; an empty one checks the robot against itself, None checks nothing.
    """

    def __init__(self, pepper: PepperModel, scene: Scene | None) -> None:
        self.pepper = pepper
        self.scene = scene

    @property
    def considered(self) -> bool:
        """Whether anything is checked."""
        return self.scene is not None

    def free(self, q: Array) -> bool:
        """Whether nothing touches at q, shape (n,) [rad or m]."""
        if self.scene is None:
            return True
        from pepper_kin.collision import in_collision

        return not bool(in_collision(self.pepper, q, self.scene))

    def free_many(self, q: Array) -> np.ndarray:
        """Whether nothing touches at each of many configurations, shape (m, n) -> (m,)."""
        if self.scene is None:
            return np.ones(len(q), dtype=bool)
        from pepper_kin.collision import in_collision

        return ~np.asarray(in_collision(self.pepper, q, self.scene), dtype=bool)

    def clearance(self, q: Array) -> float | None:
        """Return the smallest distance [m]; None where nothing is checked."""
        if self.scene is None:
            return None
        from pepper_kin.collision import clearance

        return float(clearance(self.pepper, q, self.scene))

    def fence(self) -> Fence:
        """Return a fence for one descent."""
        return Fence(self)


class Fence:
    """Half-spaces of joint positions that keep one descent clear, learnt as it goes.

    Each is one pair of bodies, linearised where it was nearest.  With (a, b) the nearest points at x, their
    distance d and n = (a - b) / d,

        g = (J_a - J_b)^T n,    d + g . (q - x) >= margin.

    A step that was refused because it would collide leaves one behind too, so the next step goes round.

    Args:
        collisions: The robot in its scene.
    """

    def __init__(self, collisions: Collisions) -> None:
        self._collisions = collisions
        self._cuts: deque[tuple[Array, float]] = deque(maxlen=CUTS)

    def admits(self, q: Array) -> bool:
        """Whether q is free; what is nearest there is remembered."""
        self._learn(q)
        return self._collisions.free(q)

    def half_spaces(self, q: Array) -> HalfSpaces | None:
        """Return what a step from q has to keep; where a margin is used up, it may not shrink further."""
        if not self._cuts:
            return None
        normals = np.array([-growth for growth, _ in self._cuts])
        offsets = np.array([max(float(growth @ q) - least, 0.0) for growth, least in self._cuts])
        return HalfSpaces(normals, offsets)

    def _learn(self, q: Array) -> None:
        from pepper_kin.collision import closest_pair

        pepper, scene = self._collisions.pepper, self._collisions.scene
        pair = closest_pair(pepper, q, scene)
        if pair is None or pair.distance > NOTICE or abs(pair.distance) < 1e-9:
            return
        normal = (pair.points[0] - pair.points[1]) / pair.distance
        first, second = (
            _point_jacobian(pepper, q, link, point)
            for link, point in zip(pair.links, pair.points, strict=True)
        )
        growth = normal @ (first - second)
        self._cuts.append((growth, MARGIN - pair.distance + float(growth @ q)))


def _point_jacobian(pepper: PepperModel, q: Array, link: str | None, point: Array) -> Array:
    """Return the Jacobian of a point fixed to a link, J_v + J_w x (p - o), shape (3, n); 0 in the world."""
    if link is None:
        return np.zeros((3, pepper.n))
    jacobian = frame_jacobian(pepper, q, link)
    arm = point - frame_pose(pepper, q, link)[:3, 3]
    return jacobian[:3] + np.cross(jacobian[3:], arm, axisa=0, axisc=0)
