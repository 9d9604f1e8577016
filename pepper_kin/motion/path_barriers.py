"""Penalties that keep a path away from contact and from torques that cannot be held."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import CollisionChecker
from pepper_kin.collision.near_pairs import pairs_within
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.motion.optimization.range_term import RangeTerm
from pepper_kin.motion.optimization.torque_term import TorqueTerm

_HELD = 0.95  # fraction of the efforts that holding still may take
_KEPT_ANGLE = 0.05  # margin to forbidden joint ranges, relative to `RangeTerm`'s influence distance
_KEPT_DISTANCE = 0.004  # distance kept beyond the margin [m]
_OF_START = 0.8  # maximum distance kept, relative to the start's: a path need not leave its start
_NEAR = 0.1  # distance that counts as a shortage of 1 [m]
_PAIRS = 8  # number of nearest pairs of bodies counted in each state


class PathBarriers:
    """Relative shortages of states: 0 if a requirement is kept, negative if it is violated.

    The requirements are joint ranges that depend on another joint, holding torques, and distances.

    Args:
        pepper: The robot.
        efforts: Torques that count as 1 [N m or N], shape (n,), inf for none.
        loads: Carried loads.
        checker: Collision checker that measures distances; None leaves distances out, which is quicker.
        margin: Distance to keep [m].
        start: Start of the path [rad or m], shape (n,): bodies that are near there may stay about as near.
    """

    def __init__(
        self,
        pepper: PepperModel,
        efforts: Array,
        loads: Loads,
        checker: CollisionChecker | None,
        margin: float,
        start: Array,
    ) -> None:
        moving = Moving(pepper, np.arange(pepper.n), pepper.neutral())
        self._ranges, self._torques = RangeTerm(moving, 0.0, 1), TorqueTerm(moving, efforts, 1, loads)
        self._checker, self._keep = checker, margin + _KEPT_DISTANCE
        if checker is not None:
            near = pairs_within(checker, start, self._keep).distances
            self._keep = float(np.min(_OF_START * near, initial=self._keep))

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Return the shortages, shape (K, r), and their Jacobians, shape (K, r, n), at q, shape (K, n)."""
        still = self._torques.rows(q, 0.0 * q, 0.0 * q)
        sign = -np.sign(still.value)[:, :, None]
        found = [(_HELD - np.abs(still.value), sign * still.by_position)]
        if self._ranges.rows_count:
            angles = self._ranges.rows(q, q, q)
            found.append((angles.value - _KEPT_ANGLE, angles.by_position))
        if self._checker is not None:
            found.append(self._distances(q))
        lack, slopes = (np.concatenate(part, axis=1) for part in zip(*found, strict=True))
        return np.minimum(lack, 0.0), np.where(lack[:, :, None] < 0.0, slopes, 0.0)

    def overloaded(self, q: Array) -> tuple[int, str, float]:
        """Return the most loaded of states q, shape (K, n), its joint, and the fraction of the effort."""
        share = np.abs(self._torques.values(q, 0.0 * q, 0.0 * q))
        if not share.size:
            return 0, "", 0.0
        k, joint = np.unravel_index(int(np.argmax(share)), share.shape)
        return int(k), self._torques.joint_names[joint], float(share[k, joint])

    def _distances(self, q: Array) -> tuple[Array, Array]:
        assert self._checker is not None
        value, slopes = np.zeros((len(q), _PAIRS)), np.zeros((len(q), _PAIRS, q.shape[1]))
        for k, state in enumerate(q):
            near = pairs_within(self._checker, state, self._keep)
            count = min(len(near), _PAIRS)
            value[k, :count] = (near.distances[:count] - self._keep) / _NEAR
            slopes[k, :count] = near.gradients[:count] / _NEAR
        return value, slopes
