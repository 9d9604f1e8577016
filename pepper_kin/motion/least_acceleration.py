"""Minimum-acceleration joint positions along a whole path of tasks, as one banded problem.

At nodes s_0 < ... < s_K of a path's parameter, with x = q / (acceleration limits),

    minimize  sum_i w_i |(x'')_i|^2 + 10 sum_i d_i |(x')_i|^2 + sum_k h_k sum_i rho_ki (x_k - g_k)_i^2
    subject to  r(q_k; s_k) = 0,

with s relative to the path's length, x'' by divided differences of three nodes and x' of two nodes, weights
w, d and h proportional to the length at each node, and g a posture to stay near.  Without x', the free end of
a path would drift away at no cost.  Tasks are linearized in each step (Gauss-Newton).  At every node their
rows have a null space, computed by a singular value decomposition, in which the remaining problem is a banded
positive definite system (null-space method: Nocedal and Wright, Numerical Optimization, 2006, section 16.2).
Position limits are penalized if exceeded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.path_blocks import solve_path_blocks

Rows: TypeAlias = Callable[[Array], tuple[Array, Array]]

LONGEST_STEP = 0.5
"""Maximum change of a joint in one step [rad or m]."""

_SPEED = 10.0  # weight of x', relative to x'', with a path of length 1: about (half a wave)^2
_DAMPING = 1e-2  # damping relative to a node's largest singular value
_ENOUGH = 0.02  # relative gain of the cost below which a step is the last
_LEAST_HELD, _MORE_HELD, _LESS_HELD, _TRIALS = 1e-3, 8.0, 4.0, 7
_LEAST_SLOPE = 1.0  # minimum gradient norm by which barriers are divided
_STIFF = 1000.0  # weight of a limit's penalty, relative to the bending weight at the node


class PathNodes(NamedTuple):
    """Nodes of a path, and the quadratic form of its bending.

    Attributes:
        s: Path parameters of the nodes, increasing, shape (K,); a closed path is given without its end.
        closed: Whether the path is closed.
        bend: Sum of w c c^T of all divided differences c, with the coupling of nodes k and k + d at [d, k],
            shape (3, K), modulo K if closed.
        share: Fraction h of the path's length at each node, shape (K,).
    """

    s: Array
    closed: bool
    bend: Array
    share: Array

    @classmethod
    def of(cls, s: Array, corners: Array, closed: bool, length: float, emphasis: Array) -> PathNodes:
        """Return nodes of a path.

        Args:
            s: Path parameters of the nodes, shape (K,).
            corners: Parameters at which the path may bend freely, shape (m,).
            closed: Whether the path is closed.
            length: The path's length.
            emphasis: Factors on w at the nodes, shape (K,).
        """
        steps = np.diff(s, append=[length] if closed else []) / length
        count = len(s)
        before, after = (np.roll(steps, 1), steps) if closed else (steps[:-1], steps[1:])
        middle = np.arange(count) if closed else np.arange(1, count - 1)
        smooth = ~np.isin(s[middle], corners)
        middle, before, after = middle[smooth], before[smooth], after[smooth]
        c = 2.0 / (before + after) * np.stack([1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after])
        weight, bend = emphasis[middle] * (before + after) / 2, np.zeros((3, count))
        places = [(middle + d) % count for d in (-1, 0, 1)]
        for a in range(3):
            for b in range(a, 3):
                np.add.at(bend[b - a], places[a], weight * c[a] * c[b])
        for place, d, sign in ((0, 0, 1.0), (1, 0, 1.0), (0, 1, -1.0)):
            np.add.at(bend[d], (np.arange(len(steps)) + place) % count, sign * _SPEED / steps)
        share = np.zeros(count)
        np.add.at(share, np.arange(len(steps)), steps / 2)
        np.add.at(share, (np.arange(len(steps)) + 1) % count, steps / 2)
        return cls(s, closed, bend, share)

    def bent(self, x: Array) -> Array:
        """Return the product of the bending matrix and x, shape (K, n)."""
        found = self.bend[0, :, None] * x
        here = np.arange(len(x))
        for d in (1, 2):
            after, before = (here + d) % len(x), here - d
            found += self.bend[d, :, None] * x[after] + self.bend[d, before, None] * x[before]
        return found


class _Point(NamedTuple):
    """Tasks and objective at a point.

    Attributes:
        x: Positions of the moving joints, in units of `NodeProblem.scale`, shape (K, k).
        residual: Residuals of the equations, shape (K, m).
        rows: Derivatives of the residuals by x, shape (K, m, k).
        gradient: Gradient of the objective without `more`, shape (K, k).
        weight: Diagonal terms of the objective in addition to `PathNodes.bend`, shape (K, k).
        more: Values, shape (K, w), and derivatives, shape (K, w, k), whose squares also belong to the
            objective.
        objective: Half the sum of all squares.
    """

    x: Array
    residual: Array
    rows: Array
    gradient: Array
    weight: Array
    more: list[tuple[Array, Array]]
    objective: float

    def cost(self, price: float) -> float:
        """Return the objective plus the sum of absolute residuals times a price."""
        return self.objective + price * float(np.abs(self.residual).sum())


class _Model(NamedTuple):
    """The linearized problem at a point.

    Attributes:
        across: Minimum-norm step onto the tasks, shape (K, k).
        inverse: Damped pseudo-inverse of the rows, shape (K, k, m); zero at the first node, which is fixed.
        null: Bases of the rows' null spaces, shape (K, d, k).
        rows_along: Derivatives of `_Point.more` along the null spaces, shape (K, w, d).
        gradient: Gradient of the objective after the step across, shape (K, k).
        weight: Diagonal terms of the objective, shape (K, k).
        multipliers: Lagrange multipliers of the equations, shape (K, m).
    """

    across: Array
    inverse: Array
    null: Array
    rows_along: Array
    gradient: Array
    weight: Array
    multipliers: Array

    def onto(self, residual: Array) -> Array:
        """Return the minimum-norm step, shape (K, k), that removes a residual, shape (K, m)."""
        return -np.einsum("knr,kr->kn", self.inverse, residual)


class NodeProblem(NamedTuple):
    """Optimization problem of one set of nodes; the first node is the robot's current position.

    Attributes:
        nodes: The nodes.
        equations: Function from joint positions of all nodes to residuals that must vanish, and their
            Jacobians.
        preferences: Function to weighted residuals to be minimized, and their Jacobians; None for none.
        barriers: Function to penalty residuals, which count where their Jacobians are not zero; None for
            none.
        scale: Joint positions that correspond to x = 1 [rad or m], shape (n,).
        limits: Lower and upper position bounds [rad or m], shape (2, n).
        near: Posture g to stay near at each node [rad or m], shape (K, n).
        nearness: Weight rho of the distance from g, shape (K, n).
        moving: Whether a joint may move, shape (n,).
    """

    nodes: PathNodes
    equations: Rows
    preferences: Rows | None
    barriers: Rows | None
    scale: Array
    limits: Array
    near: Array
    nearness: Array
    moving: np.ndarray

    def solved(self, q: Array, steps: int, still: float, met: float) -> Array:
        """Return joint positions [rad or m], shape (K, n), after Gauss-Newton steps.

        A step is accepted if it lowers the objective plus the residuals times a price above their
        multipliers; else it is shortened by a proximal term (Levenberg and Marquardt), which shrinks again
        with accepted steps.

        Args:
            q: Initial joint positions [rad or m], shape (K, n).
            steps: Maximum number of steps.
            still: Step size below which the iteration may end [rad or m].
            met: Largest residual with which the iteration may end.
        """
        x, held = q[:, self.moving] / self.scale[self.moving], _LEAST_HELD
        point = self._point(q, x)
        for _ in range(steps):
            model = self._model(point)
            price = 2.0 * np.abs(model.multipliers).max(initial=0.0)
            for _ in range(_TRIALS):
                x = point.x + model.across + self._along(model, held)
                # Project onto the tasks again, with the same rows: else their curvature rejects good steps.
                x = x + model.onto(self.equations(self._whole(q, x))[0])
                trial = self._point(self._whole(q, x), x)
                longest = np.abs((x - point.x) * self.scale[self.moving]).max()
                if longest <= LONGEST_STEP and trial.cost(price) <= point.cost(price):
                    break
                held *= _MORE_HELD
            else:
                return self._whole(q, point.x)
            gain = 1.0 - trial.cost(price) / max(point.cost(price), 1e-300)
            point, held = trial, max(held / _LESS_HELD, _LEAST_HELD)
            if np.abs(trial.residual).max() < met and (longest < still or gain < _ENOUGH):
                break
        return self._whole(q, point.x)

    def _whole(self, q: Array, x: Array) -> Array:
        whole = q.copy()
        whole[:, self.moving] = x * self.scale[self.moving]
        return whole

    def _point(self, q: Array, x: Array) -> _Point:
        """Return the tasks and the objective at joint positions q, shape (K, n), with their moving part x."""
        residual, rows = self.equations(q)
        scale, nodes = self.scale[self.moving], self.nodes
        rest = x - self.near[:, self.moving] / scale
        outside = x - np.clip(x, *self.limits[:, self.moving] / scale)
        stiff, pull = _STIFF * nodes.bend[0], nodes.share[:, None] * self.nearness[:, self.moving]
        bent = nodes.bent(x)
        value = (x * bent).sum() + (pull * rest**2).sum() + (stiff[:, None] * outside**2).sum()
        more = []
        for rows_of, is_barrier in ((self.preferences, False), (self.barriers, True)):
            if rows_of is None:
                continue
            lacking, slopes = rows_of(q)
            slopes = slopes[:, :, self.moving] * scale
            factor = np.sqrt(nodes.share)[:, None]
            if is_barrier:
                steep = np.maximum(np.linalg.norm(slopes, axis=2), _LEAST_SLOPE)
                factor = np.sqrt(stiff)[:, None] / steep
            more.append((lacking * factor, slopes * factor[:, :, None]))
            value += float(((lacking * factor) ** 2).sum())
        gradient = bent + pull * rest + stiff[:, None] * outside
        weight = np.where(outside != 0.0, stiff[:, None], 0.0) + pull
        return _Point(
            x, residual, rows[:, :, self.moving] * scale, gradient, weight, more, 0.5 * float(value)
        )

    def _model(self, point: _Point) -> _Model:
        """Return the linearized problem at a point: the step onto the tasks, and the null spaces."""
        left, size, right = np.linalg.svd(point.rows)
        rank = size.shape[1]
        gain = size / (size**2 + (_DAMPING * size.max()) ** 2 + 1e-300)
        inverse = np.einsum("kin,ki,kri->knr", right[:, :rank], gain, left[:, :, :rank])
        inverse[0] = 0.0
        across = -np.einsum("knr,kr->kn", inverse, point.residual)
        gradient = point.gradient + self.nodes.bent(across) + point.weight * across
        null, along = np.ascontiguousarray(right[:, rank:]), list[Array]()
        for lacking, slopes in point.more:
            lack = lacking + np.einsum("kmn,kn->km", slopes, across)
            gradient += np.einsum("kmn,km->kn", slopes, lack)
            along.append(np.einsum("kmn,kin->kmi", slopes, null))
        multipliers = np.einsum("knr,kn->kr", inverse, gradient)
        none = np.zeros((len(null), 0, null.shape[1]))
        rows_along = np.ascontiguousarray(np.concatenate(along, axis=1)) if along else none
        return _Model(across, inverse, null, rows_along, gradient, point.weight, multipliers)

    def _along(self, model: _Model, held: float) -> Array:
        """Return the step along the tasks, (K, k), with a proximal term of `held` times the bending."""
        values = np.ascontiguousarray(-np.einsum("kin,kn->ki", model.null, model.gradient))
        if values.size == 0 or len(values) == 1:
            return np.zeros_like(model.across)
        weight = np.ascontiguousarray(model.weight + held * self.nodes.bend[0][:, None])
        if not solve_path_blocks(
            model.null, self.nodes.bend, weight, model.rows_along, self.nodes.closed, values
        ):
            return np.zeros_like(model.across)
        values[0] = 0.0
        return np.asarray(np.einsum("kin,ki->kn", model.null, values))
