"""The tasks of one structure as an expression: errors, cost, gradient and Gauss-Newton matrix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.ik.fast.structure import Structure
from pepper_kin.ik.fast.task_residuals import (
    LARGEST_KINDS,
    MASS_KINDS,
    Motion,
    task_residual,
)
from pepper_kin.ik.tasks.task import HARD_WEIGHT
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.center_of_mass import center_of_mass, center_of_mass_jacobian
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.jacobians import jacobian_columns, reduced_rows
from pepper_kin.symbolic.poses import world_frames
from pepper_kin.symbolic.states import make_state, new_inputs
from pepper_kin.symbolic.tree import read_tree

if TYPE_CHECKING:
    import casadi


def task_function(pepper: PepperModel, tasks: Sequence[Structure], index: np.ndarray) -> casadi.Function:
    """Return the function (q, weights, targets) -> what one step of a local search needs.

    With r_i the residual of task i, J_i its derivative by the joints of `index`, and s_i^2 its weight w_i^2,
    times HARD_WEIGHT^2 where it is hard,

        errors_i = |r_i|^2,   cost = sum_i s_i^2 |r_i|^2 / 2,
        gradient = sum_i s_i^2 J_i^T r_i,   matrix = sum_i s_i^2 J_i^T J_i (upper triangle, row by row).

    The error of a posture, and of the center of mass over the wheels, is the largest component, squared.

    Args:
        pepper: The robot.
        tasks: Structures of the tasks.
        index: Indices of the joints to differentiate by, shape (k,).

    Returns:
        Function of q (n), w^2 (number of tasks) and all targets one after the other; one output `step`.
    """
    import casadi

    q, weights = casadi.SX.sym("q", pepper.n), casadi.SX.sym("weights", len(tasks))
    targets = casadi.SX.sym("targets", sum(task.target_size for task in tasks))
    motion = _motion(pepper, tasks, q)
    errors, cost = [], casadi.SX(0)
    gradient = casadi.SX(index.size, 1)
    matrix = casadi.SX(index.size, index.size)
    place = 0
    for i, task in enumerate(tasks):
        target = targets[place : place + task.target_size]
        place += task.target_size
        residual, jacobian = task_residual(pepper, task, motion, target)
        jacobian = jacobian[:, index.tolist()]
        square = casadi.sumsqr(residual)
        errors.append(_largest_square(residual) if task.kind in LARGEST_KINDS else square)
        strength = weights[i] * HARD_WEIGHT**2 if task.hard else weights[i]
        cost += 0.5 * strength * square
        gradient += strength * (jacobian.T @ residual)
        matrix += strength * (jacobian.T @ jacobian)
    upper = [matrix[i, j] for i in range(index.size) for j in range(i, index.size)]
    step = casadi.densify(casadi.vertcat(*errors, cost, gradient, *upper))
    return casadi.Function("ik_step", [q, weights, targets], [casadi.cse(step)])


def _motion(pepper: PepperModel, tasks: Sequence[Structure], q: Any) -> Motion:
    """Return all that the tasks' residuals are written in."""
    named = [name for task in tasks for name in (task.frame, task.reference) if name]
    frames = tuple(dict.fromkeys(named))
    outputs = _frames_function(pepper, frames)(q) if frames else ()
    known = {frame: (outputs[2 * k], outputs[2 * k + 1]) for k, frame in enumerate(frames)}
    center: tuple[Any, ...] = ()
    if any(task.kind in MASS_KINDS for task in tasks):
        center = (center_of_mass(pepper)(q), center_of_mass_jacobian(pepper)(q))
    return Motion(q, known, center)


def _frames_function(pepper: PepperModel, frames: tuple[str, ...]) -> casadi.Function:
    """Return q -> (pose, Jacobian) of each frame, all written on one graph so that they share operations."""
    tree = read_tree(pepper, compact=True)
    graph, inputs = new_inputs(tree, "q")
    state = make_state(tree, inputs["q"])
    outputs: dict[str, Any] = {}
    for k, (frame, (rotation, position)) in enumerate(zip(frames, world_frames(state, frames), strict=True)):
        outputs[f"pose{k}"] = [(*turn, x) for turn, x in zip(rotation, position, strict=True)]
        outputs[f"jacobian{k}"] = reduced_rows(tree.full_map, jacobian_columns(state, frame)[0])
    return make_function("ik_frames", graph, inputs, outputs)


def _largest_square(residual: Any) -> Any:
    import casadi

    largest = residual[0] ** 2
    for k in range(1, residual.numel()):
        largest = casadi.fmax(largest, residual[k] ** 2)
    return largest
