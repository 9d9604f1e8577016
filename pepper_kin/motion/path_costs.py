"""Soft costs along a path: compiled prices of configurations, and their integral along a curve."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.ik.fast.expression import residuals
from pepper_kin.ik.tasks.expression import expression_of, values_and_slopes
from pepper_kin.ik.tasks.structure import TaskStructure, target_of
from pepper_kin.ik.tasks.task import checked_weight
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.motion.constraints import SOURCES, InPython, as_constraints, soft_structures
from pepper_kin.trajectory.path import CubicPath

if TYPE_CHECKING:
    import casadi

SAMPLES = 24
"""Number of samples of each piece of a curve over which a cost is summed."""


@dataclass(frozen=True, eq=False, init=False)
class PathCost:
    """A price w c(q) >= 0 of being at a configuration, for each meter of the path.

        hand = pk.symbolic.frame_pose(pepper, "LArm_effector")
        high = pk.motion.PathCost(pepper, lambda q: 20 * (1.1 - hand(q)[2, 3]) ** 2)

    Lengths are measured in the planners' metric, |b dq|, with b_j the maximum distance that joint j moves a
    point of the body, see `pepper_kin.collision.motion_tree.motion_bounds`.  Where w c is 1, a piece of the
    path counts twice its length.

    Attributes:
        source: The function q -> c(q), serialized by CasADi.
        joint_names: Joints of the robot that the cost was made for, whose constants it contains.
        weight: Weight w.
        label: Name of the cost, in words.
    """

    source: str
    joint_names: tuple[str, ...]
    weight: float
    label: str

    def __init__(
        self, pepper: PepperModel, function: Callable[[Any], Any], weight: float = 1.0, *, label: str = "cost"
    ) -> None:
        """Evaluate the function for symbols q and keep the expression.

        Args:
            pepper: The robot.
            function: Function from q, a column `casadi.SX` of n joint positions [rad or m], to one
                expression, in which functions of `pk.symbolic` may be called.  Negative values count as 0.
            weight: Weight w, above zero.
            label: Name of the cost, in words.

        Raises:
            InvalidValueError: for a function that does not return one expression of q, or an invalid weight.
        """
        source, _, count = expression_of(pepper, function, label)
        if count != 1:
            raise InvalidValueError(f"function of {label}", f"{count} values", "one")
        vars(self).update(
            source=source, joint_names=pepper.joint_names, weight=checked_weight(weight, label), label=label
        )

    def values(self, q: Array) -> Array:
        """Return the prices w c, shape (m,), at configurations q [rad or m], shape (m, n).

        Raises:
            InvalidValueError: for another shape, NaN or infinity.
        """
        evaluate = values_and_slopes(self.source)
        states = as_finite(q, "q", (None, len(self.joint_names)))
        return np.array([self.weight * max(float(evaluate(x)[0][0]), 0.0) for x in states])


class CostAlong(NamedTuple):
    """A soft cost along a plan's curve.

    Attributes:
        label: What it is.
        integral: Integral of the price along the curve [m].
        before: Integral of the price along the plan made without costs [m]; infinite if there is none.
        mean: Mean price: integral divided by length.
        highest: Maximum price at a sample.
    """

    label: str
    integral: float
    before: float
    mean: float
    highest: float


class PathFigures(NamedTuple):
    """Length of a curve in the metric [m]; integrals [m], means and maxima of the prices, shape (k,) each."""

    length: float
    integrals: Array
    means: Array
    highest: Array

    @property
    def total(self) -> float:
        """Sum of the length and all integrals [m]."""
        return self.length + float(self.integrals.sum())


@dataclass(frozen=True, eq=False)
class PathCosts:
    """Soft costs of one robot.

    The price of a task with residual r, weight w and tolerance rho is (w |r| / rho)^2: at the tolerance a
    piece of the path counts twice.

    Attributes:
        pepper: The robot.
        costs: Costs of expressions.
        tasks: Tasks with one target and a finite tolerance each.
    """

    pepper: PepperModel
    costs: tuple[PathCost, ...]
    tasks: tuple[Task, ...]

    @classmethod
    def of(cls, pepper: PepperModel, requested: Sequence[PathCost | Task | TaskGroup]) -> PathCosts:
        """Return requested costs after checks, with groups of tasks split.

        Raises:
            InvalidValueError: for items other than costs and tasks, costs of a robot with other joints, a
                task with several targets, or an infinite tolerance.
            UnknownNameError: for a frame or joint that the robot lacks.
        """
        if not isinstance(requested, (PathCost, Task, TaskGroup, Iterable)) or isinstance(requested, str):
            raise InvalidValueError("costs", repr(requested), "a list of PathCost and tasks")
        items = [requested] if isinstance(requested, (PathCost, Task, TaskGroup)) else list(requested)
        costs = tuple(item for item in items if isinstance(item, PathCost))
        for cost in costs:
            if cost.joint_names != pepper.joint_names:
                got = f"an expression of {len(cost.joint_names)} joints of another robot"
                raise InvalidValueError(cost.label, got, f"one of {', '.join(pepper.joint_names)}")
        others = [item for item in items if not isinstance(item, PathCost)]
        if not items:
            raise InvalidValueError("costs", "none", "at least one PathCost or task")
        tasks = as_constraints(pepper, others) if others else ()
        return cls(pepper, costs, tasks)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the costs, in words."""
        return (*(cost.label for cost in self.costs), *(task.name for task in self.tasks))

    def prices(self, q: Array) -> Array:
        """Return the price of each cost, shape (m, k), at configurations q [rad or m], shape (m, n)."""
        if self._compiled:
            found = np.asarray(self._kernel(q, self._numbers))[:, 1 + self.pepper.n :]
            return np.maximum(found, 0.0)
        columns = [cost.values(q) for cost in self.costs]
        for task in self.tasks:
            scale = (task.weight / task.tolerance) ** 2
            columns.append(np.array([scale * float(np.sum(task.residual(self.pepper, x) ** 2)) for x in q]))
        return np.stack(columns, axis=1)

    def for_planner(self, frozen: Array, free: NDArray[np.int64]) -> planners.StateCost:
        """Return the sum of the prices as a cost for planners.

        Args:
            frozen: A whole configuration with the other joints' positions [rad or m], shape (n,).
            free: Indices of the joints that move, shape (k,).
        """
        if not self._compiled:
            return planners.StateCost(self._in_python(frozen, free), int(free.size))
        kernel, kernel_input = self._kernel, np.concatenate([frozen, self._numbers])
        width = self.pepper.n + len(self.labels)  # the individual prices follow the gradient
        (written,), work = kernel.signature.output_sizes, kernel.work_size
        address = kernel.address_of("single", inputs=kernel_input.size, outputs=written, work=work)
        code = planners.CompiledManifold(
            address, kernel_input, free, free, width, work, keep_alive=kernel, size=written
        )
        return planners.StateCost(code, int(free.size))

    def figures(self, curve: CubicPath, weights: Array) -> PathFigures:
        """Return length, integrals, means and maxima along a curve.

        Args:
            curve: The curve.
            weights: Weights of the metric, shape (n,).
        """
        spans = np.diff(curve.breaks)
        segments = np.repeat(np.arange(spans.size), SAMPLES)
        local = (np.tile(np.arange(SAMPLES), spans.size) + 0.5) / SAMPLES * spans[segments]
        steps = np.linalg.norm(curve.at(segments, local, 1) * weights, axis=1) * spans[segments] / SAMPLES
        prices, length = self.prices(np.ascontiguousarray(curve.at(segments, local))), float(steps.sum())
        integrals = steps @ prices
        ends = self.prices(curve.at(np.append(np.arange(spans.size), -1), np.append(0 * spans, spans[-1])))
        highest = np.maximum(prices.max(axis=0), ends.max(axis=0))
        return PathFigures(length, integrals, integrals / length, highest)

    def along(self, found: PathFigures, before: PathFigures | None) -> tuple[CostAlong, ...]:
        """Return the costs that a plan reports.

        Args:
            found: Figures along the plan's curve.
            before: Figures along the curve of the plan without costs; None if there is none.
        """
        old = np.full(len(self.labels), np.inf) if before is None else before.integrals
        rows = zip(self.labels, found.integrals, old, found.means, found.highest, strict=True)
        return tuple(CostAlong(label, *map(float, numbers)) for label, *numbers in rows)

    @property
    def _compiled(self) -> bool:
        return soft_structures(self.tasks) is not None

    @property
    def _numbers(self) -> Array:
        """Targets of the tasks, then the weight of each cost."""
        weights = [*(c.weight for c in self.costs), *((t.weight / t.tolerance) ** 2 for t in self.tasks)]
        return np.concatenate([*(target_of(task) for task in self.tasks), weights])

    @property
    def _kernel(self) -> Kernel:
        """The compiled kernel of the costs."""
        sources = tuple(cost.source for cost in self.costs)
        return _kernel(self.pepper, sources, soft_structures(self.tasks) or ())

    def _in_python(self, frozen: Array, free: NDArray[np.int64]) -> Callable[[Array], tuple[Array, Array]]:
        """Return the function from states [rad or m], shape (m, k), to prices and their gradients.

        The prices have shape (m, 1), the gradients shape (m, 1, k).

        Args:
            frozen: A whole configuration with the other joints' positions [rad or m], shape (n,).
            free: Indices of the joints that move, shape (k,).
        """
        tasks = [InPython(self.pepper, (task,), frozen, free) for task in self.tasks]
        whole = tasks[0].whole

        def evaluate(states: Array) -> tuple[Array, Array]:
            """Return prices, shape (m, 1), and gradients, shape (m, 1, k), at states, shape (m, k)."""
            price, slope = np.zeros((len(states), 1)), np.zeros((len(states), 1, free.size))
            for cost in self.costs:
                both = [values_and_slopes(cost.source)(x) for x in whole(states)]
                price[:, 0] += [cost.weight * max(float(value[0]), 0.0) for value, _ in both]
                slope[:, 0] += [cost.weight * (value[0] > 0) * slopes[0, free] for value, slopes in both]
            for task, function in zip(self.tasks, tasks, strict=True):
                values, slopes = function(states)
                scale = (task.weight / task.tolerance) ** 2
                price[:, 0] += scale * np.sum(values**2, axis=1)
                slope[:, 0] += 2 * scale * np.einsum("mr,mrk->mk", values, slopes)
            return price, slope

        return evaluate


@kept_for_robot(most=64)
def _kernel(pepper: PepperModel, sources: tuple[str, ...], structures: tuple[TaskStructure, ...]) -> Kernel:
    """Return the compiled kernel of prices and their gradient."""
    by = source_digest(*SOURCES, __name__)
    key = f"path costs {sources!r} {structures!r} of {robot_digest(pepper)} by {by}"
    return compile_function(lambda: _expression(pepper, sources, structures), key=key)


def _expression(
    pepper: PepperModel, sources: Sequence[str], structures: tuple[TaskStructure, ...]
) -> casadi.Function:
    """Return the CasADi function (q, targets and weights) -> sum of prices, its gradient, each price."""
    import casadi

    q = casadi.SX.sym("q", pepper.n)
    size = sum(task.target_size for task in structures)
    kernel_input = casadi.SX.sym("inputs", size + len(sources) + len(structures))
    weights = kernel_input[size:]
    values = [casadi.fmax(casadi.Function.deserialize(source)(q), 0.0) for source in sources]
    slopes = [casadi.jacobian(value, q) for value in values]
    for residual, jacobian in residuals(pepper, structures, q, kernel_input[:size]):
        values.append(casadi.sumsqr(residual))
        slopes.append(2 * (residual.T @ jacobian))
    prices = [weights[k] * value for k, value in enumerate(values)]
    slope = sum((weights[k] * row for k, row in enumerate(slopes)), casadi.SX(1, pepper.n))
    output = casadi.vertcat(sum(prices), casadi.vec(casadi.densify(slope)), *prices)
    return casadi.Function("path_costs", [q, kernel_input], [casadi.cse(casadi.densify(output))])
