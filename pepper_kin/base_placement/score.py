"""Score of base placements, a weighted mean of named terms."""

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
"""Clearance at which its term reaches the maximum of 1 [m]."""

METERS_PER_RADIAN = 0.3
"""Distance that costs as much as a rotation by one radian [m/rad]."""

_SAMPLES = 1000


@dataclass(frozen=True)
class PlacementWeights:
    """Weights of the terms of the score; a term of weight 0 is ignored.

    The score is sum_k w_k s_k / sum_k w_k, with s_k between 0 (bad) and 1 (good); terms that do not apply (a
    clearance without a scene, a manipulability without a frame that goes to a point) are left out of both
    sums.

    Attributes:
        limit_margin: Weight of the minimum distance of used joints to their nearer limit over all targets,
            relative to half of the joint's range.
        manipulability: Weight of the minimum sqrt(det(J J^T)) of frames that go to points over all targets,
            relative to the maximum among random postures.
        clearance: Weight of the minimum distance to obstacles over all targets, relative to 10 cm, at most 1.
        travel: Weight of 1 / (1 + d), with d the distance from the current base pose [m]; a rotation of 1 rad
            counts as 0.3 m.
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
    """Terms of a score, see `PlacementWeights`.

    Attributes:
        limit_margin: Minimum distance of a joint to its limit relative to half of its range, 0 to 1; None if
            no joint with limits is used.
        tightest_joint: Joint with the minimum margin; empty for none.
        manipulability: Ratio to the maximum manipulability, 0 to 1; None if no frame goes to a point.
        clearance: Minimum distance to the obstacles of the scene [m]; None without obstacles.
        distance: Distance from the current base pose [m].
        turn: Rotation from the current heading [rad], 0 to pi.
    """

    limit_margin: float | None
    tightest_joint: str
    manipulability: float | None
    clearance: float | None
    distance: float
    turn: float


class Scorer:
    """Computation of the terms of base poses with known configurations.

    Args:
        moving: The robot with a moving base.
        sets: Sets of tasks.
        movable: Mask of the joints of the moving robot that may move, without the base's, shape (robot.n,).
        q0: Joint positions at the start, shape (n,) [rad or m].
        stand: Current base pose: x, y [m] and yaw [rad], shape (3,).
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
        """Return the minimum margin over sets and its joint's index, shape (N,) each, at q, shape (T, N, n).

        The margin is NaN and the index -1 if no joint with limits is used.
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
        """Return the minimum ratio to the maximum manipulability, shape (N,), at q, shape (T, N, n)."""
        least = np.full(q.shape[1], np.inf)
        for states, frames in zip(q, self._frames, strict=True):
            for frame in frames:
                value = manipulability(self._moving.robot, states, frame, joints=self._joints)
                least = np.minimum(least, value / self._largest[frame])
        return np.where(np.isinf(least), np.nan, np.minimum(least, 1.0))

    def travels(self, places: Array) -> tuple[Array, Array]:
        """Return distances [m] and rotations [rad] from the current base pose to others, shape (N, 3)."""
        shift = places - self._stand
        return np.hypot(shift[:, 0], shift[:, 1]), np.abs(wrapped(shift[:, 2]))

    def scores(self, margin: Array, skill: Array, clearance: Array, distance: Array, turn: Array) -> Array:
        """Return the scores from terms, shape (N,) each; NaN terms and infinite clearances are left out."""
        weights = self._weights
        way = distance + METERS_PER_RADIAN * turn
        near = np.where(np.isinf(clearance), np.nan, np.clip(clearance / ENOUGH_CLEARANCE, 0.0, 1.0))
        shares = np.array([margin, skill, near, 1.0 / (1.0 + way)])
        factors = np.array([weights.limit_margin, weights.manipulability, weights.clearance, weights.travel])
        factors = np.where(np.isnan(shares), 0.0, factors[:, None])
        total = factors.sum(axis=0)
        return np.asarray((factors * np.nan_to_num(shares)).sum(axis=0) / np.where(total > 0, total, 1.0))

    def _most_manipulable(self, frame: str, q0: Array, movable: np.ndarray) -> float:
        """Return the maximum manipulability of a frame among random postures.

        `q0` has shape (n,) [rad or m]; `movable` is a mask over the moving robot, shape (robot.n,).
        """
        moving, robot = self._moving, self._moving.robot
        states = moving.states(q0, np.zeros((_SAMPLES, 3)))
        low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -math.pi)[movable]
        high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, math.pi)[movable]
        states[:, movable] = np.random.default_rng(0).uniform(low, high, (_SAMPLES, low.size))
        return max(float(manipulability(robot, states, frame, joints=self._joints).max()), 1e-12)
