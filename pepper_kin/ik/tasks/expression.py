"""Task that keeps CasADi expressions of the joint positions at a value or between bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables
from pepper_kin.ik.tasks.task import POSITION_TOLERANCE, TargetTask, words_for
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_numbers

UNBOUNDED = 1e300
"""Bound that stands for none, so that machine code computes with finite numbers."""


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Expression(TargetTask):
    """The values f(q) of an expression lie between bounds: r = max(f - upper, 0) + min(f - lower, 0).

        height = pk.symbolic.frame_pose(pepper, "LArm_effector")
        level = pk.ik.Expression(pepper, lambda q: height(q)[2, 3] - 0.8, tolerance=0.005)

    The error is the largest component of r; for an equation, lower = upper, r = f - lower. dr/dq = df/dq by
    CasADi in rows where a bound is reached, 0 in other rows. The expression is compiled at its first use, in
    some tenths of a second, and cached on disk; other bounds do not compile it again.

    Attributes:
        source: Function q -> f(q), serialized by CasADi.
        joint_names: Joint names of the robot for which the expression was made, whose constants it contains.
        joints: Names of the joints on which f depends.
        target: Lower and upper bounds, shape (2, m), read-only; ±`UNBOUNDED` for none.
        quantity: Unit of f: "m", "rad", or any other text for messages.
    """

    source: str
    joint_names: tuple[str, ...]
    joints: tuple[str, ...]
    target: Array
    quantity: str
    unit: ClassVar[str] = "m"
    target_axes: ClassVar[int] = 2
    largest: ClassVar[bool] = True

    def __init__(
        self,
        pepper: PepperModel,
        function: Callable[[Any], Any],
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        tolerance: float = POSITION_TOLERANCE,
        *,
        label: str = "expression",
        unit: str = "m",
        weight: float = 1.0,
        hard: bool = False,
    ) -> None:
        """Evaluate the function for symbols q and keep the expression.

        Args:
            pepper: The robot.
            function: From q, a column `casadi.SX` of n joint positions [rad or m], to m expressions;
                functions of `pk.symbolic` may be called in it. A `casadi.Function` is allowed.
            lower: Lower bounds, one or m numbers; none if omitted.
            upper: Upper bounds, one or m numbers; none if omitted.  Without any bounds, the target of all
                values is 0.
            tolerance: Maximum amount by which a value may exceed its bounds [unit].
            label: Name of the expression in words.
            unit: Unit of the values: "m", "rad", or any other text for messages.
            weight: Weight in the sum of squares.
            hard: Whether the task has priority over soft tasks.

        Raises:
            InvalidValueError: for a function that does not return expressions of q, bounds of another shape
                or that exclude each other, or an invalid weight or tolerance.
        """
        source, joints, count = expression_of(pepper, function, label)
        if lower is None and upper is None:
            lower = upper = 0.0
        low = _bounds(lower, f"lower bound of {label}", count, -UNBOUNDED)
        high = _bounds(upper, f"upper bound of {label}", count, UNBOUNDED)
        if (low > high).any():
            raise InvalidValueError(f"lower bound of {label}", lower, f"at most the upper bound, {high}")
        super().__init__(
            label, weight=weight, tolerance=tolerance, hard=hard, quantity=unit,
            source=source, joint_names=pepper.joint_names, joints=joints,
            target=read_only(np.stack([low, high])),
        )  # fmt: skip

    @cached_property
    def _evaluate(self) -> Callable[[Array], tuple[Array, Array]]:
        return values_and_slopes(self.source)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without CasADi's function, which cannot be pickled."""
        return {name: value for name, value in vars(self).items() if name != "_evaluate"}

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot whose joints differ from the robot's for which the expression was made.

        Raises:
            InvalidValueError: for a robot with other joints.
        """
        if pepper.joint_names != self.joint_names:
            got = f"an expression of {len(self.joint_names)} joints of another robot"
            raise InvalidValueError(self.label, got, f"one of {', '.join(pepper.joint_names)}")

    def values(self, q: Array) -> Array:
        """Return f(q), shape (m,) [unit], at joint positions q, shape (n,) [rad or m]."""
        return self._evaluate(q)[0]

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the signed amounts by which values exceed their bounds, shape (m,) [unit]."""
        found = self.values(q)
        return np.asarray(np.maximum(found - self.target[1], 0.0) + np.minimum(found - self.target[0], 0.0))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return df/dq in rows of values at or beyond a bound, 0 in other rows, shape (m, n)."""
        found, slopes = self._evaluate(q)
        return np.where(((found <= self.target[0]) | (found >= self.target[1]))[:, None], slopes, 0.0)

    def dependence(self, pepper: PepperModel, q: Array) -> Array:
        """Return df/dq, shape (m, n), which does not vanish between the bounds."""
        return self._evaluate(q)[1]

    def unit_on(self, pepper: PepperModel) -> str:
        """Return the unit of the values."""
        return self.quantity

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the value with the largest violation of its bounds, in words, at q, shape (n,)."""
        residual = self.residual(pepper, q)
        k = int(np.argmax(np.abs(residual)))
        bound = self.target[1, k] if residual[k] > 0 else self.target[0, k]
        side = "above" if residual[k] > 0 else "below"
        which = f"value {k} of {self.label}" if residual.size > 1 else self.label
        return f"{which} is {words_for(abs(residual[k]), self.quantity)} {side} {bound:.4g}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the values in words, at joint positions q, shape (n,) [rad or m]."""
        return f"value {', '.join(f'{value:.4g}' for value in self.values(q))} {self.quantity}".rstrip()

    def _structure(self) -> TaskStructure:
        joints, size = self.joints, self.target.size
        return TaskStructure(Expression, joints=joints, target_size=size, hard=self.hard, source=self.source)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return max(f - upper, 0) + min(f - lower, 0), and df/dq in rows where a bound is reached."""
        import casadi

        values = casadi.Function.deserialize(task.source)(motion.q)
        slopes, (lower, upper) = casadi.jacobian(values, motion.q), casadi.vertsplit(target, values.numel())
        beyond = casadi.if_else(casadi.logic_or(values <= lower, values >= upper), 1.0, 0.0)
        rows = [beyond[k] * slopes[k, :] for k in range(values.numel())]
        return casadi.fmax(values - upper, 0.0) + casadi.fmin(values - lower, 0.0), casadi.vertcat(*rows)


def expression_of(
    pepper: PepperModel, function: Callable[[Any], Any], label: str
) -> tuple[str, tuple[str, ...], int]:
    """Return the function q -> f(q) serialized by CasADi, the joints on which f depends, and its size m.

    Args:
        pepper: The robot.
        function: Function from q to expressions, see `Expression`.
        label: Name of the expression in messages.

    Raises:
        InvalidValueError: for a function that returns no expressions of q.
    """
    import casadi

    allowed = "a function from q, a casadi.SX, to a casadi.SX that depends on it"
    if not callable(function):
        raise InvalidValueError(f"function of {label}", repr(function), allowed)
    q = casadi.SX.sym("q", pepper.n)
    found: Any = "an error:"
    try:
        found = function(q)
        parts = list(found) if isinstance(found, (list, tuple)) else [found]
        values = casadi.densify(casadi.vertcat(*[casadi.vec(casadi.SX(part)) for part in parts]))
        made = casadi.Function("expression", [q], [casadi.cse(values)], ["q"], ["values"])
    except (NotImplementedError, RuntimeError, TypeError) as error:
        got = f"{type(found).__name__} {str(error).strip().splitlines()[-1][:120]}"
        raise InvalidValueError(f"function of {label}", got, allowed) from None
    pattern = casadi.jacobian(values, q).sparsity()
    joints = tuple(pepper.joint_names[j] for j in sorted(set(pattern.get_triplet()[1])))
    if not joints:
        raise InvalidValueError(f"function of {label}", "values that depend on no joint", allowed)
    return made.serialize(), joints, int(values.numel())


@lru_cache(maxsize=256)
def values_and_slopes(source: str) -> Callable[[Array], tuple[Array, Array]]:
    """Return the function from q, shape (n,), to f, shape (m,), and df/dq, shape (m, n), run by CasADi."""
    import casadi

    function = casadi.Function.deserialize(source)
    q = casadi.SX.sym("q", function.size1_in(0))
    values = function(q)
    both = casadi.Function("both", [q], [values, casadi.densify(casadi.jacobian(values, q))])

    def evaluate(state: Array) -> tuple[Array, Array]:
        found, slopes = both(state)
        return np.asarray(found)[:, 0], np.asarray(slopes)

    return evaluate


def _bounds(limits_like: ArrayLike | None, quantity: str, count: int, missing: float) -> Array:
    """Return bounds, shape (m,), from one number or m numbers; infinity or None means no bound.

    Args:
        limits_like: One bound, m bounds, shape (m,), or None.
        quantity: Name of the bounds in messages.
        count: m.
        missing: Bound that stands for None.

    Raises:
        InvalidValueError: for another shape, NaN, or anything but numbers.
    """
    bounds = np.array(missing) if limits_like is None else as_numbers(limits_like, quantity)
    if bounds.shape not in ((), (1,), (count,)):
        raise InvalidValueError(quantity, f"shape {bounds.shape}", f"one number or {count}")
    bounds = np.broadcast_to(bounds, (count,))
    return np.clip(bounds, -UNBOUNDED, UNBOUNDED)
