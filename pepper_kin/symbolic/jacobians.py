"""Frame Jacobians and their rate of change."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.poses import world_poses
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import StateExpressions, new_state
from pepper_kin.symbolic.vectors import IDENTITY, ZERO, Vector, add, cross, scale, times, transpose

if TYPE_CHECKING:
    import casadi

Columns = list[tuple[Value, ...]]


@remembered
def frame_jacobian(pepper: PepperModel, frame: str) -> casadi.Function:
    """Return the function q -> J(q) of a frame: (velocity of its origin, angular velocity) = J(q) v.

    Args:
        pepper: The robot.
        frame: Name of a frame, see `pepper.frame_names`.

    Returns:
        Function of q (n); output `jacobian` (6, n), linear first, in world axes at the frame's origin
        [m/rad, rad/rad]; columns of joints that do not move the frame are structural zeros.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """
    state, symbols = new_state(pepper, "q")
    rows = reduced_rows(state.tree.full_map, jacobian_columns(state, frame)[0])
    return symbols.function("frame_jacobian", jacobian=rows)


@remembered
def frame_jacobian_rate(pepper: PepperModel, frame: str) -> casadi.Function:
    """Return the function (q, v) -> dJ/dt of a frame, so that its acceleration is J a + dJ/dt v.

    Args:
        pepper: The robot.
        frame: Name of a frame, see `pepper.frame_names`.

    Returns:
        Function of q, v (n each); output `jacobian_rate` (6, n), rows as in `frame_jacobian`, per second.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """
    state, symbols = new_state(pepper, "q", "v")
    rows = reduced_rows(state.tree.full_map, jacobian_columns(state, frame)[1])
    return symbols.function("frame_jacobian_rate", jacobian_rate=rows)


def jacobian_columns(state: StateExpressions, frame: str) -> tuple[Columns, Columns]:
    """Return the columns of J and of dJ/dt for all coordinates of `pinocchio_model`.

    A column is (z x (p - p_i), z), or (z, 0) for a prismatic joint, with z its axis and p_i its body's
    origin in the world.
    """
    tree = state.tree
    body, _, place = tree.anchor(frame)
    path = tree.path(body)
    poses = world_poses(state)
    still: tuple[Value, ...] = (0.0,) * 6
    columns: Columns = [still] * len(tree.bodies)
    rates: Columns = [still] * len(tree.bodies)
    if body < 0:
        return columns, rates
    arms: dict[int, Vector] = {}  # from one origin of the path to the next, in world axes
    for i, inner in zip(path, [-1, *path[:-1]], strict=True):
        arms[i] = times(poses[inner][0] if inner >= 0 else IDENTITY, state.translations[i])
    omega, spins, along = ZERO, {}, {}
    for i in path:
        axis = transpose(poses[i][0])[2]
        along[i] = scale(state.v[i], axis)
        spins[i] = omega  # angular velocity of the parent, which rotates the axis
        if not tree.bodies[i].slides:
            omega = add(omega, along[i])
    reach = times(poses[body][0], place)
    reach_rate = cross(omega, reach)
    for i in reversed(path):
        axis = transpose(poses[i][0])[2]
        axis_rate = cross(spins[i], axis)
        arm_rate = cross(spins[i], arms[i])
        if tree.bodies[i].slides:
            columns[i], rates[i] = (*axis, *ZERO), (*axis_rate, *ZERO)
            arm_rate = add(arm_rate, along[i])
        else:
            columns[i] = (*cross(axis, reach), *axis)
            rates[i] = (*add(cross(axis_rate, reach), cross(axis, reach_rate)), *axis_rate)
        reach, reach_rate = add(reach, arms[i]), add(reach_rate, arm_rate)
    return columns, rates


def reduced_rows(full_map: Array, columns: Columns) -> list[list[Value]]:
    """Return A E as rows of n expressions, from the columns of A.

    Args:
        full_map: E, from the robot's n coordinates to the N joints' coordinates, shape (N, n).
        columns: N columns of A, one for each joint.
    """
    gains = full_map.tolist()
    rows = []
    for k in range(len(columns[0])):
        row: list[Value] = [0.0] * full_map.shape[1]
        for i, column in enumerate(columns):
            for j, gain in enumerate(gains[i]):
                row[j] = row[j] + gain * column[k]
        rows.append(row)
    return rows
