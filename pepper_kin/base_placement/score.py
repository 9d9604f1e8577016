"""Scores of base placements, as a sum of named terms."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.base_placement.moving_base import MovingBase, wrapped
from pepper_kin.base_placement.task_sets import TaskSet
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import joints_used
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.kinematics import manipulability
from pepper_kin.model.joint_vectors import as_real

ENOUGH_CLEARANCE = 0.10
"""A clearance of this much counts in full [m]."""

METERS_PER_RADIAN = 0.3
"""A turn on the spot is as dear as so long a way [m/rad]."""

_SAMPLES = 1000


@dataclass(frozen=True)
class PlacementWeights:
    """Weights of the terms of the score; a term of weight 0 is ignored.

    The score is sum_k w_k s_k / sum_k w_k, with s_k between 0 (bad) and 1 (good); terms that do not apply (a
    clearance without a scene, a manipulability without a frame that goes to a point) are left out of both
    sums.

    Attributes:
        limit_margin: s is the least distance of a joint that a task uses to its nearer limit, as a share of
            half of its range, over all targets.
        manipulability: s is the least sqrt(det(J J^T)) of the frames that go to points, as a share of the
            largest among random postures, over all targets.
        clearance: s is the least distance to the obstacles over all targets, as a share of 10 cm, at most 1.
        travel: s is 1 / (1 + d), with d the way from the current place [m], a turn of 1 rad as 0.3 m.
    """

    limit_margin: float = 1.0
    manipulability: float = 1.0
    clearance: float = 1.0
    travel: float = 1.0

    def __post_init__(self) -> None:
        total = 0.0
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not 0 <= as_real(value) < math.inf:
                raise InvalidValueError(
                    f"weight of {entry.name}", repr(value), "a finite number of 0 or more"
                )
            total += value
        if total == 0:
            raise InvalidValueError("weights", "all 0", "at least one above 0")


@dataclass(frozen=True)
class PlacementTerms:
    """The quantities behind a score; see `PlacementWeights`.

    Attributes:
        limit_margin: Share of half a joint's range that is left to its limit, 0 to 1; None where no joint
            with limits is used.
        tightest_joint: The joint with that margin; empty for none.
        manipulability: Share of the largest manipulability, 0 to 1; None where no frame goes to a point.
        clearance: Least distance to the obstacles of the scene [m]; None without any.
        distance: Way from the current place [m].
        turn: Turn from the current heading [rad], 0 to pi.
    """

    limit_margin: float | None
    tightest_joint: str
    manipulability: float | None
    clearance: float | None
    distance: float
    turn: float


class Scorer:
    """Computes the terms of places at which configurations are known.

    Args:
        moving: The robot with a moving base.
        sets: Sets of tasks.
        movable: Joints of the moving robot that may move, except the base's; a mask of shape (robot.n,).
        q0: Joint positions to come from, shape (n,) [rad or m].
        stand: The current place, shape (3,): x, y [m] and yaw [rad].
        weights: Weights of the terms.
    """

    def __init__(
        self,
        moving: MovingBase,
        sets: tuple[TaskSet, ...],
        movable: np.ndarray,
        q0: Array,
        stand: Array,
        weights: PlacementWeights,
    ) -> None:
        self._moving, self._stand, self._weights = moving, stand, weights
        robot = moving.robot
        limited = np.isfinite(robot.lower_limits) & np.isfinite(robot.upper_limits)
        self._used = [np.flatnonzero(movable & limited & joints_used(robot, tasks)) for tasks in sets]
        self._joints = moving.names(movable)
        self._frames = [
            tuple(sorted({task.frame for task in tasks if isinstance(task, FramePosition)})) for tasks in sets
        ]
        self._largest = {
            frame: self._most_manipulable(frame, q0, movable) for group in self._frames for frame in group
        }

    def limit_margins(self, q: Array) -> tuple[Array, np.ndarray]:
        """Return the least margin over sets, shape (N,), and its joint, shape (N,), of q, shape (T, N, n).

        The margin is NaN and the joint -1 where no joint with limits is used.
        """
        robot, count = self._moving.robot, q.shape[1]
        least, joint = np.full(count, np.inf), np.full(count, -1)
        for states, used in zip(q, self._used, strict=True):
            if not used.size:
                continue
            low, high = robot.lower_limits[used], robot.upper_limits[used]
            half = np.maximum((high - low) / 2, 1e-12)
            margins = np.minimum(states[:, used] - low, high - states[:, used]) / half
            tightest = margins.argmin(axis=1)
            margin = np.maximum(margins[np.arange(count), tightest], 0.0)
            joint = np.where(margin < least, used[tightest], joint)
            least = np.minimum(least, margin)
        return np.where(joint < 0, np.nan, least), joint

    def manipulabilities(self, q: Array) -> Array:
        """Return the least share of the largest manipulability, shape (N,), of q, shape (T, N, n)."""
        least = np.full(q.shape[1], np.inf)
        for states, frames in zip(q, self._frames, strict=True):
            for frame in frames:
                value = manipulability(self._moving.robot, states, frame, joints=self._joints)
                least = np.minimum(least, value / self._largest[frame])
        return np.where(np.isinf(least), np.nan, np.minimum(least, 1.0))

    def travels(self, places: Array) -> tuple[Array, Array]:
        """Return ways [m] and turns [rad] from the current place to places, shape (N, 3)."""
        shift = places - self._stand
        return np.hypot(shift[:, 0], shift[:, 1]), np.abs(wrapped(shift[:, 2]))

    def scores(self, margin: Array, skill: Array, clearance: Array, distance: Array, turn: Array) -> Array:
        """Return the scores, shape (N,), of quantities of that shape; NaN and infinite ones are left out."""
        weights = self._weights
        way = distance + METERS_PER_RADIAN * turn
        near = np.where(np.isinf(clearance), np.nan, np.clip(clearance / ENOUGH_CLEARANCE, 0.0, 1.0))
        shares = np.array([margin, skill, near, 1.0 / (1.0 + way)])
        factors = np.array([weights.limit_margin, weights.manipulability, weights.clearance, weights.travel])
        factors = np.where(np.isnan(shares), 0.0, factors[:, None])
        total = factors.sum(axis=0)
        return np.asarray((factors * np.nan_to_num(shares)).sum(axis=0) / np.where(total > 0, total, 1.0))

    def _most_manipulable(self, frame: str, q0: Array, movable: np.ndarray) -> float:
        """Return the largest manipulability of a frame among random postures.

        `q0` has shape (n,) [rad or m]; `movable` is a mask over the moving robot, shape (robot.n,).
        """
        moving, robot = self._moving, self._moving.robot
        states = moving.states(q0, np.zeros((_SAMPLES, 3)))
        low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -math.pi)[movable]
        high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, math.pi)[movable]
        states[:, movable] = np.random.default_rng(0).uniform(low, high, (_SAMPLES, low.size))
        return max(float(manipulability(robot, states, frame, joints=self._joints).max()), 1e-12)
