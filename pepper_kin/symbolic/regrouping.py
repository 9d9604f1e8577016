"""Mass on a joint's axis belongs to the parent: the same motion with fewer parameters.

A thin rod along a revolute axis does not move when the joint turns.  So each body's mass m, its moment h_z
and its second moment Sigma_zz along the axis may be taken off the body and fixed to the parent instead, where
they are constants again: every torque, momentum and energy stays exactly the same, and three of ten
parameters are gone (the base parameters of Gautier and Khalil, 1990, in the form of second moments).  A body
that slides does not turn relative to its parent: its six second moments go to the parent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.symbolic.bodies import Body, Inertia, clean, numbers

Array = NDArray[np.float64]


def regroup(bodies: Sequence[Body], ground: Inertia) -> tuple[list[Body], Inertia]:
    """Move what a joint does not move to the parent, from the tips to the world.

    Args:
        bodies: Parents before children.
        ground: Inertia that the world has already.

    Returns:
        The bodies with their new inertias, and what has reached the world.
    """
    state = [_as_arrays(body.inertia) for body in bodies] + [_as_arrays(ground)]
    for i in reversed(range(len(bodies))):
        body = bodies[i]
        mass, first, second = state[i]
        rotation, translation = np.array(body.rotation), np.array(body.translation)
        if body.slides:
            given = (0.0, np.zeros(3), second)
        else:
            z = np.array([0.0, 0.0, 1.0])
            given = (mass, first[2] * z, second[2, 2] * np.outer(z, z))
        state[i] = (mass - given[0], first - given[1], second - given[2])
        parent = body.parent if body.parent >= 0 else len(bodies)
        more = _moved(*given, rotation, translation)
        mass, first, second = state[parent]
        state[parent] = (mass + more[0], first + more[1], second + more[2])
    result = [replace(body, inertia=_as_inertia(*s)) for body, s in zip(bodies, state[:-1], strict=True)]
    return result, _as_inertia(*state[-1])


def _moved(
    mass: float, first: Array, second: Array, rotation: Array, translation: Array
) -> tuple[float, Array, Array]:
    """Return a mass distribution seen from another frame: x -> R x + r."""
    turned = rotation @ first
    cross = np.outer(translation, turned)
    second = rotation @ second @ rotation.T + cross + cross.T + mass * np.outer(translation, translation)
    return mass, turned + mass * translation, second


def _as_arrays(inertia: Inertia) -> tuple[float, Array, Array]:
    return inertia.mass, np.array(inertia.first), np.array(inertia.second)


def _as_inertia(mass: float, first: Array, second: Array) -> Inertia:
    return Inertia(float(mass), numbers(clean(first)), numbers(clean(second)))
