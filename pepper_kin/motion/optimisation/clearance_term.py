"""Distances to the scene and to the robot itself as slacks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.collision import Scene
from pepper_kin.motion.optimisation.bodies_of import bodies_of
from pepper_kin.motion.optimisation.moving import Moving
from pepper_kin.motion.optimisation.near_rows import near_rows
from pepper_kin.planners.optimisation import Rows, Wall

Array = NDArray[np.float64]

INFLUENCE = 0.08
"""Distances beyond the margin by this do not act on a motion [m]."""
MOST_PAIRS = 8
"""Number of pairs that act at one sample: the nearest ones."""
_SPARE = 2e-3  # [m]


class ClearanceTerm:
    """(distance - margin - floor) / (influence - floor) of the nearest pairs at each sample.

    The floor is zero, but where the motion to start from is nearer than the margin: there it lies a little
    below that motion's distance, until `tighten` finds that the margin is kept.

    Args:
        moving: The joints that move.
        scene: The world around the robot.
        margin: Distance to keep to the scene and between parts of the robot [m].
        per_interval: Samples in each interval of the spline.
        only_moving: Whether pairs that the moving joints carry alike are left out: a hand that hangs near the
            hip would lower the floor under the other hand's way.
    """

    def __init__(
        self, moving: Moving, scene: Scene, margin: float, per_interval: int, *, only_moving: bool = False
    ) -> None:
        self.per_interval, self.wall, self.kinked = per_interval, Wall.ABOVE_ZERO, True
        self._moving, self._margin = moving, margin
        self._bodies, self._frames = bodies_of(moving.pepper, scene, margin)
        self._poses = kernel(moving.pepper, "frame_poses", self._frames) if self._frames else None
        # d/dq = (d/dq_full) E, where mimic joints follow by q_full = E q + e.
        self._columns = np.ascontiguousarray(moving.pepper.full_map[:, moving.joints])
        if only_moving:
            apart = (
                self._bodies.carried[self._bodies.pairs[:, 0]]
                != self._bodies.carried[self._bodies.pairs[:, 1]]
            )
            places = np.flatnonzero((apart & (self._columns != 0).any(axis=1)).any(axis=1))
            self._bodies = self._bodies._replace(
                pairs=self._bodies.pairs[places], gap=self._bodies.gap[places]
            )
        self._floor: Array | float = 0.0

    def distances(self, q: Array) -> Array:
        """Return the least distances beyond the margin at moving joints' positions, shape (K,) [m].

        Those of `INFLUENCE` and more count as `INFLUENCE`.
        """
        return self._near(q, False)[0][:, 0]

    def __len__(self) -> int:
        return len(self._bodies.pairs)

    def start_from(self, q: Array) -> None:
        """Lower the floors under a motion's distances, given at the samples, shape (K, k)."""
        self._floor = self._floor_under(q)

    def tighten(self, q: Array) -> None:
        """Raise the floors where a motion keeps more distance now; it stays above them."""
        if np.min(self._floor) < 0.0:
            self._floor = np.maximum(self._floor, self._floor_under(q))

    def _floor_under(self, q: Array) -> Array:
        distances = self.distances(q)
        # Half of what separates bodies may be used up, but no more: the floor must not let them touch.
        apart = distances + self._margin
        spare = np.where(apart > 0, np.minimum(2 * _SPARE, apart / 2), 2 * _SPARE)
        return np.where(distances > _SPARE, 0.0, distances - spare)[:, None]

    def values(self, q: Array, v: Array, a: Array) -> Array:
        """Return the slacks, shape (K, MOST_PAIRS), at states of the moving joints."""
        return (self._near(q, False)[0] - self._floor) / (INFLUENCE - self._floor)

    def rows(self, q: Array, v: Array, a: Array) -> Rows:
        """Return the slacks and their derivatives."""
        distance, gradient = self._near(q, True)
        room = INFLUENCE - self._floor
        by_position = gradient @ self._columns / np.reshape(room, (-1, 1, 1))
        return Rows((distance - self._floor) / room, by_position)

    def _near(self, q: Array, with_gradient: bool) -> tuple[Array, Array]:
        count, frames = len(q), len(self._frames)
        poses = np.empty((count, 0, 4, 4))
        if self._poses is not None:
            poses = np.asarray(self._poses(self._moving.positions(q))).reshape(count, frames, 4, 4)
        distance = np.empty((count, MOST_PAIRS))
        joints = len(self._bodies.slides)
        gradient = np.empty((count, MOST_PAIRS, joints) if with_gradient else (0, 0, 0))
        near_rows(poses, self._bodies, INFLUENCE, distance, gradient, with_gradient)
        return distance, gradient
