"""CasADi function of tasks: errors, cost, gradient and Gauss-Newton matrix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables
from pepper_kin.ik.tasks.task import HARD_WEIGHT
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.jacobians import jacobian_columns, reduced_rows
from pepper_kin.symbolic.poses import world_frames
from pepper_kin.symbolic.states import make_state, new_inputs
from pepper_kin.symbolic.tree import read_tree

if TYPE_CHECKING:
    import casadi


def task_function(pepper: PepperModel, tasks: Sequence[TaskStructure], index: np.ndarray) -> casadi.Function:
    """Return the function (q, weights, targets) -> errors, cost, gradient and matrix of a step.

    With r_i the residual of task i, J_i its Jacobian by the joints of `index`, and s_i^2 the weight w_i^2,
    times HARD_WEIGHT^2 for a hard task,

        errors_i = |r_i|^2,   cost = sum_i s_i^2 |r_i|^2 / 2,
        gradient = sum_i s_i^2 J_i^T r_i,   matrix = sum_i s_i^2 J_i^T J_i (upper triangle, row by row).

    The error of a task with `largest` is its largest squared component.

    Args:
        pepper: The robot.
        tasks: Structures of the tasks.
        index: Indices of the joints to differentiate by, shape (k,).

    Returns:
        Function of q (n), w^2 (number of tasks) and the concatenated targets, with one output.
    """
    import casadi

    q, weights = casadi.SX.sym("q", pepper.n), casadi.SX.sym("weights", len(tasks))
    targets = casadi.SX.sym("targets", sum(task.target_size for task in tasks))
    errors, cost = [], casadi.SX(0)
    gradient = casadi.SX(index.size, 1)
    matrix = casadi.SX(index.size, index.size)
    for i, (task, (residual, jacobian)) in enumerate(
        zip(tasks, residuals(pepper, tasks, q, targets), strict=True)
    ):
        jacobian = jacobian[:, index.tolist()]
        square = casadi.sumsqr(residual)
        errors.append(_largest_square(residual) if task.kind.largest else square)
        strength = weights[i] * HARD_WEIGHT**2 if task.hard else weights[i]
        cost += 0.5 * strength * square
        gradient += strength * (jacobian.T @ residual)
        matrix += strength * (jacobian.T @ jacobian)
    upper = [matrix[i, j] for i in range(index.size) for j in range(i, index.size)]
    step = casadi.densify(casadi.vertcat(*errors, cost, gradient, *upper))
    return casadi.Function("ik_step", [q, weights, targets], [casadi.cse(step)])


def rows_function(pepper: PepperModel, tasks: Sequence[TaskStructure]) -> casadi.Function:
    """Return the function (q, targets) -> residuals of all tasks (m), and their Jacobian by q (m, n)."""
    import casadi

    q = casadi.SX.sym("q", pepper.n)
    targets = casadi.SX.sym("targets", sum(task.target_size for task in tasks))
    rows = zip(*residuals(pepper, tasks, q, targets), strict=True)
    outputs = [casadi.densify(casadi.vertcat(*part)) for part in rows]
    return casadi.Function("ik_rows", [q, targets], casadi.cse(outputs))


def residuals(
    pepper: PepperModel, tasks: Sequence[TaskStructure], q: Any, targets: Any
) -> list[tuple[Any, Any]]:
    """Return the residual of each task and its Jacobian by q as expressions.

    Args:
        pepper: The robot.
        tasks: Structures of the tasks.
        q: Symbols, shape (n,).
        targets: Symbols of the concatenated targets.
    """
    motion, found, place = _motion(pepper, tasks, q), [], 0
    for task in tasks:
        target = targets[place : place + task.target_size]
        found.append(task.kind.expression(task, motion, target))
        place += task.target_size
    return found


def _motion(pepper: PepperModel, tasks: Sequence[TaskStructure], q: Any) -> TaskVariables:
    """Return the variables of the tasks' residuals."""
    named = [name for task in tasks for name in (task.frame, task.reference) if name]
    frames = tuple(dict.fromkeys(named))
    outputs = _frames_function(pepper, frames)(q) if frames else ()
    known = {frame: (outputs[2 * k], outputs[2 * k + 1]) for k, frame in enumerate(frames)}
    return TaskVariables(pepper, q, known)


def _frames_function(pepper: PepperModel, frames: tuple[str, ...]) -> casadi.Function:
    """Return q -> (pose, Jacobian) of each frame, on one graph so that frames share operations."""
    tree = read_tree(pepper, compact=True)
    graph, inputs = new_inputs(tree, "q")
    state = make_state(tree, inputs["q"])
    outputs: dict[str, Any] = {}
    for k, (frame, (rotation, position)) in enumerate(zip(frames, world_frames(state, frames), strict=True)):
        outputs[f"pose{k}"] = [(*turn, x) for turn, x in zip(rotation, position, strict=True)]
        outputs[f"jacobian{k}"] = reduced_rows(tree.full_map, jacobian_columns(state, frame)[0])
    return make_function("ik_frames", graph, inputs, outputs)


def _largest_square(residual: Any) -> Any:
    """Return the largest squared component of a residual."""
    import casadi

    largest = residual[0] ** 2
    for k in range(1, residual.numel()):
        largest = casadi.fmax(largest, residual[k] ** 2)
    return largest
