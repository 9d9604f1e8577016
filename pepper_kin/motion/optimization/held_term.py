"""Barrier term of IK tasks that stay met along a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik import Task
from pepper_kin.motion.constraints import manifold_of, residuals_of
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.planners.optimization import BarrierBound, Rows

SHARE = 0.97
"""Fraction of a tolerance that is used at samples: between them the error may be slightly larger."""
_SPARE = 0.02


class HeldTerm:
    """Slack 1 - |r|^2 / (SHARE tolerance)^2 of each task's residual r, above 0 if the task is met.

    As in `ClearanceTerm`, a floor below zero admits initial motions that violate the tasks, and rises as
    motions improve.

    Args:
        moving: The joints that move.
        tasks: Tasks with one target and a finite tolerance each; the sequence may be empty.
        per_interval: Samples in each interval of the spline.

    Raises:
        InvalidValueError: for a task with several targets, or an infinite tolerance.
        UnknownNameError: for a frame or joint that the robot lacks.
    """

    def __init__(self, moving: Moving, tasks: Sequence[Task], per_interval: int) -> None:
        self.per_interval, self.barrier_bound = per_interval, BarrierBound.ABOVE_ZERO
        self._count, self._floor = 0, np.zeros((1, 1))
        if not tasks:
            return
        manifold = manifold_of(moving.pepper, tasks, moving.rest, moving.joints)
        self._residuals = residuals_of(moving.pepper, tasks, moving.rest, moving.joints)
        self._count = np.size(manifold.tolerances)
        # sums[g, r] = 1 / tolerance_g^2 for the residuals r of constraint g
        self._sums = (np.arange(self._count)[:, None] == manifold.groups) / (
            SHARE * np.asarray(manifold.tolerances)[:, None]
        ) ** 2

    @property
    def rows_count(self) -> int:
        """Number of rows of a sample."""
        return self._count

    def start_from(self, q: Array) -> None:
        """Set the floors below a motion of the moving joints [rad or m], at the samples, shape (K, k)."""
        self._floor = self._floor_under(q)

    def tighten(self, q: Array) -> None:
        """Raise the floors where a motion keeps the tasks better now; the motion stays above them.

        Args:
            q: Positions of the moving joints at the samples [rad or m], shape (K, k).
        """
        if np.min(self._floor) < 0.0:
            self._floor = np.maximum(self._floor, self._floor_under(q))

    def values(self, q: Array, v: Array, a: Array) -> Array:
        """Return the slacks relative to their floors, shape (K, number of tasks).

        Args:
            q: Positions of the moving joints at the samples [rad or m], shape (K, k).
            v: Velocities of the moving joints, shape (K, k); not used.
            a: Accelerations of the moving joints, shape (K, k); not used.
        """
        return (self._slacks(self._residuals(q)[0]) - self._floor) / (1.0 - self._floor)

    def rows(self, q: Array, v: Array, a: Array) -> Rows:
        """Return the slacks of `values`, and their derivatives by q, shape (K, number of tasks, k).

        Args:
            q: Positions of the moving joints at the samples [rad or m], shape (K, k).
            v: Velocities of the moving joints, shape (K, k); not used.
            a: Accelerations of the moving joints, shape (K, k); not used.
        """
        residual, slope = self._residuals(q)
        by_position = -2.0 * np.einsum("gr,kr,krj->kgj", self._sums, residual, slope)
        slack = 1.0 - self._floor
        scaled = by_position / np.broadcast_to(slack, by_position.shape[:2])[..., None]
        return Rows((self._slacks(residual) - self._floor) / slack, scaled)

    def _slacks(self, residual: Array) -> Array:
        """Return the slacks of g tasks, shape (K, g), from all residuals [m or rad], shape (K, r)."""
        return 1.0 - residual**2 @ self._sums.T

    def _floor_under(self, q: Array) -> Array:
        """Return floors of g tasks, shape (K, g), below a motion of the moving joints, shape (K, k)."""
        slacks = self._slacks(self._residuals(q)[0])
        return np.where(slacks > _SPARE, 0.0, slacks - 2 * _SPARE * (1.0 + np.abs(slacks)))
