"""Torques as a linear function of the inertial parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import product
from pepper_kin.symbolic.bodies import clean, numbers
from pepper_kin.symbolic.inverse_dynamics import Wrench
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.motion import Motion, moment, motions, to_parent
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import follow, new_state
from pepper_kin.symbolic.vectors import ZERO, cross, times

if TYPE_CHECKING:
    import casadi

_TENSOR_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@remembered
def regressor(pepper: PepperModel) -> casadi.Function:
    """Return the function (q, v, a) -> Y with tau = Y(q, v, a) pi.

    pi holds ten parameters for each moving body, bodies in the order of `pepper.inner_model` (links fixed to
    a body are part of it): m, m c_x, m c_y, m c_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, moments of inertia
    about the origin of the body's joint frame, in its axes; Pinocchio's `inertia.toDynamicParameters()`
    returns them.

    Args:
        pepper: The robot.

    Returns:
        Function of q, v, a (n each); output `regressor` (n, 10 bodies).
    """
    state, symbols = new_state(pepper, "q", "v", "a", compact=False)
    count = len(state.tree.bodies)
    full: list[list[Value]] = [[0.0] * (10 * count) for _ in range(count)]
    for i, motion in enumerate(motions(state)):
        for k, wrench in enumerate(_parameter_wrenches(motion, state.tree.alignments[i].rotation)):
            j = i
            while j >= 0:
                full[j][10 * i + k] = wrench[0][2] if state.tree.bodies[j].slides else wrench[1][2]
                wrench = to_parent(state, j, *wrench)
                j = state.tree.bodies[j].parent
    columns = [follow(state.tree.full_map.T, [row[k] for row in full]) for k in range(10 * count)]
    rows = [[column[i] for column in columns] for i in range(pepper.n)]
    return symbols.function("regressor", regressor=rows)


def _parameter_wrenches(motion: Motion, axes: Array) -> list[Wrench]:
    """Return the wrenches of a body with one of the ten inertial parameters at 1 and the others at 0.

    Args:
        motion: Motion of the body, in the body's axes.
        axes: Axes of the body in the joint's frame, in which the parameters are given, shape (3, 3).
    """
    wrenches: list[Wrench] = [(motion.a, ZERO)]
    for k in range(3):
        first = numbers(axes.T[:, k])
        wrenches.append((times(motion.field(), first), cross(first, motion.a)))
    for k, m in _TENSOR_PLACES:
        tensor = np.zeros((3, 3))
        tensor[k, m] = tensor[m, k] = 1.0
        tensor = product(product(axes.T, tensor), axes)
        second = clean((tensor[0, 0] + tensor[1, 1] + tensor[2, 2]) / 2 * np.eye(3) - tensor)
        wrenches.append((ZERO, moment(motion, numbers(second))))
    return wrenches
