"""Tables of a robot for machine code that computes the dynamics of one state."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.batch import KERNEL_FROM, over_states
from pepper_kin.core.tree_dynamics import JOINT, LINK, TreeTables, work_size
from pepper_kin.kernels.compiled_function import INTERPRETED, CompiledFunction
from pepper_kin.model import PepperModel, dynamics_model, kept_for_robot
from pepper_kin.model.joint_vectors import check_choice
from pepper_kin.model.moving_tree import MovingTree, moving_tree

TABLES = "tree tables"
"""Where `pepper.kept` has the tables of each thread, of a robot that Pinocchio does not compute.

The functions of this package call `one_state` first, which looks there: that serves the frequent case, (n,)
arrays of floats within range; `all_states` serves all others."""

SOLVERS = ("compiled", "pinocchio")
"""Solvers of one state: machine code with tables of any robot, or Pinocchio, the reference."""


def _by_pinocchio(pepper: PepperModel, solver: str) -> bool:
    """Return whether Pinocchio computes: chosen by name, or by the robot's `solvers`.

    Raises:
        InvalidValueError: for an unknown solver.
    """
    if solver == "robot":
        return pepper.solvers == "reference"
    check_choice("solver", solver, ("robot", *SOLVERS))
    return solver == "pinocchio"


def by_kernel(pepper: PepperModel, solver: str, quantity: str) -> tuple[str] | None:
    """Return the quantity whose kernel computes many states; None if Pinocchio does, one by one."""
    return None if _by_pinocchio(pepper, solver) else (quantity,)


def _tables_for(pepper: PepperModel, solver: str) -> TreeTables | None:
    """Return the tables of a robot for this thread; None if Pinocchio computes.

    Raises:
        InvalidValueError: for an unknown solver.
    """
    if _by_pinocchio(pepper, solver):
        return None
    kept = pepper.kept.setdefault(TABLES, threading.local())
    if not hasattr(kept, "tables"):
        kept.tables = _with_memory(_tables(pepper))
    found: TreeTables | None = kept.tables
    return found


def _with_memory(tables: TreeTables | None) -> TreeTables | None:
    """Return tables with a separate workspace."""
    return None if tables is None else tables._replace(work=np.empty(work_size(len(tables.links))))


def one_state(
    function: CompiledFunction, pepper: PepperModel, solver: str, shape: tuple[int, ...], *state: Any
) -> Array | None:
    """Return a new array, computed by a function of `core.tree_dynamics` for one state.

    Returns:
        The result; None if the arguments must be converted or refused, or Pinocchio computes.
    """
    tables = getattr(pepper.kept.get(TABLES), "tables", None) if solver == "robot" else None
    if tables is None:
        tables = _tables_for(pepper, solver)
    if tables is None:
        return None
    result = np.empty(shape)
    try:
        return result if function.native(tables, *state, result) else None
    except TypeError:  # lists, other dtypes, another number of dimensions, rows that are not contiguous
        return None


def _few_states(
    function: CompiledFunction, pepper: PepperModel, solver: str, shape: tuple[int, ...], *states: Any
) -> Array | None:
    """Return the results of a few rows in the frequent case: contiguous (count, n) arrays of floats in range.

    Returns:
        The results, shape (count, *shape); None if `over_states` has to convert, refuse or use a kernel.
    """
    size: tuple[int, ...] = states[0].shape if isinstance(states[0], np.ndarray) else ()
    if len(size) != 2 or not 0 < size[0] < KERNEL_FROM:
        return None
    tables = _tables_for(pepper, solver)
    if tables is None or not all(type(array) is np.ndarray and array.shape == size for array in states):
        return None
    results = np.empty((size[0], *shape))
    try:
        done = all(function.native(tables, *row) for row in zip(*states, results, strict=True))
    except TypeError:  # other dtypes, rows that are not contiguous
        return None
    return results if done else None


def all_states(
    function: CompiledFunction,
    pepper: PepperModel,
    solver: str,
    shape: tuple[int, ...],
    reference: Callable[..., Array],
    quantity: str,
    **quantities: ArrayLike,
) -> Array:
    """Return a quantity for any states that can be converted, shape (..., *shape).

    Args:
        function: Function of `core.tree_dynamics`.
        pepper: The robot.
        solver: "robot", or one of SOLVERS.
        shape: Shape of the result for one state.
        reference: Function that computes the quantity by Pinocchio from (n,) vectors, as a new array.
        quantity: Name of the quantity in `symbolic.QUANTITIES`.
        **quantities: Joint vectors, as for `batch.over_states`.

    Raises:
        InvalidValueError: for invalid joint vectors, see `batch.over_states`.
    """
    few = _few_states(function, pepper, solver, shape, *quantities.values())
    if few is not None:
        return few

    def one(*state: Array) -> Array:
        found = one_state(function, pepper, solver, shape, *map(np.ascontiguousarray, state))
        return reference(*state) if found is None else found

    one = reference if _by_pinocchio(pepper, solver) else one
    return over_states(pepper, one, shape, by_kernel(pepper, solver, quantity), **quantities)


@kept_for_robot(most=1)
def _tables(pepper: PepperModel) -> TreeTables | None:
    """Return the tables; None if Pinocchio would refuse the robot for its size, and for debugging."""
    if INTERPRETED or len(pepper.full_offset) > dynamics_model.MOST_COMPUTED:
        return None
    tree, model, full_map = moving_tree(pepper), pepper.inner_model, pepper.full_map
    leaders = np.abs(full_map).argmax(axis=1).tolist()
    frames = [np.eye(3), *map(_frame_along, tree.axes[1:])]
    joints = np.zeros((len(leaders), JOINT.width))
    for i, leader in enumerate(leaders):
        k, parent = i + 1, frames[tree.parents[i + 1]]
        axes, inertia = parent.T @ tree.rotations[k] @ frames[k], model.inertias[k]
        tensor, center = frames[k].T @ inertia.inertia @ frames[k], frames[k].T @ inertia.lever
        second = np.trace(tensor) / 2 * np.eye(3) - tensor + inertia.mass * np.outer(center, center)
        joints[i] = JOINT.row(
            gain=full_map[i, leader],
            offset=pepper.full_offset[i],
            rotor=model.armature[i],
            axis_x=axes[:, 0],
            axis_y=axes[:, 1],
            axis_z=axes[:, 2],
            origin=parent.T @ tree.positions[k],
            mass=inertia.mass,
            first=inertia.mass * center,
            second=second[np.triu_indices(3)],
        )
    links = [
        LINK.row(parent=tree.parents[i + 1], leader=leader, slides=tree.slides[i + 1])
        for i, leader in enumerate(leaders)
    ]
    above = _elimination_tree(tree, leaders, pepper.n)
    depths: list[int] = []
    for other in above:
        depths.append(0 if other < 0 else depths[other] + 1)
    return TreeTables(
        np.array(links, np.int64).reshape(-1, LINK.width),
        joints,
        np.array(model.gravity.linear),
        np.cumsum([0, *(depth + 1 for depth in depths)], dtype=np.int64),
        np.array(above, np.int64),
        np.empty(0),
    )


def _frame_along(axis: Array) -> Array:
    """Return a rotation matrix whose third column is a unit axis, shape (3,)."""
    x = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _elimination_tree(tree: MovingTree, leaders: list[int], n: int) -> list[int]:
    """Return the coordinate above each, -1 for none, when the rows of M are eliminated from the last on.

    Joints are coupled if one carries the other, and so are their coordinates; eliminating one couples all
    coordinates that it is coupled to.  All coordinates that may be coupled to one stand above it in the tree
    (Liu, The role of elimination trees in sparse factorization, 1990); without mimic joints it is the tree of
    the joints.
    """
    coupled: list[set[int]] = [set() for _ in range(n)]
    for joint, own in enumerate(leaders, start=1):
        for other in {leaders[above - 1] for above in tree.path(joint)} - {own}:
            coupled[max(own, other)].add(min(own, other))
    above = [-1] * n
    for own in reversed(range(n)):
        if coupled[own]:
            above[own] = max(coupled[own])
            coupled[above[own]] |= coupled[own] - {above[own]}
    return above
