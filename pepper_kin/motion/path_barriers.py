"""Penalties that keep a whole path away from contact and from torques that cannot be held."""

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

_HELD = 0.95  # of the efforts, to hold still
_KEPT_ANGLE = 0.05  # of `RangeTerm`'s influence
_KEPT_DISTANCE = 0.004  # [m] beyond the margin
_OF_START = 0.8  # of what the start keeps: no path has to flee from where it begins
_NEAR = 0.1  # [m] that counts as 1
_PAIRS = 8  # of a state, the nearest


class PathBarriers:
    """Shares by which states lack what they should keep, below 0, and 0 where they keep it.

    They are of joint ranges that depend on another joint, of torques that hold still, and of distances.

    Args:
        pepper: The robot.
        efforts: Torques that count as 1 [N m or N], shape (n,), inf for none.
        loads: What is carried.
        checker: Measures distances; None leaves them out, which is quicker.
        margin: Distance to keep [m].
        start: Where a path begins [rad or m], shape (n,): what is near there may stay as near.
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
        """Return the shares, shape (K, r), and their derivatives, shape (K, r, n), at q, shape (K, n)."""
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
        """Return which of K states, shape (K, n), takes most of a joint's effort, its name, and how much."""
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
