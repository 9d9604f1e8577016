"""Base parameters: inertia on a joint's axis moved to the parent, for equal torques with fewer parameters.

A thin rod along a revolute axis does not move when the joint turns.  So each body's mass m, its moment h_z
and its second moment Sigma_zz along the axis may be removed from the body and added to the parent instead,
where they are constants as well: torques, momenta and energies remain exactly equal, and three of ten
parameters vanish (the base parameters of Gautier and Khalil, 1990, in the form of second moments).  A body on
a prismatic joint does not rotate relative to its parent: its six second moments move to the parent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model.shapes import product
from pepper_kin.symbolic.bodies import Inertia, SymbolicBody, clean, numbers


def regroup(bodies: Sequence[SymbolicBody], ground: Inertia) -> tuple[list[SymbolicBody], Inertia]:
    """Move the inertia that a joint does not affect to the parent, from the tips to the world.

    Args:
        bodies: Bodies, parents before children.
        ground: Inertia of links fixed to the world.

    Returns:
        The bodies with their new inertias, and the inertia fixed to the world.
    """
    state = [_as_arrays(body.inertia) for body in bodies] + [_as_arrays(ground)]
    for i in reversed(range(len(bodies))):
        body = bodies[i]
        mass, first, second = state[i]
        rotation, translation = np.array(body.rotation), np.array(body.translation)
        if body.slides:
            removed = (0.0, np.zeros(3), second)
        else:
            z = np.array([0.0, 0.0, 1.0])
            removed = (mass, first[2] * z, second[2, 2] * np.outer(z, z))
        state[i] = (mass - removed[0], first - removed[1], second - removed[2])
        parent = body.parent if body.parent >= 0 else len(bodies)
        more = _moved(*removed, rotation, translation)
        mass, first, second = state[parent]
        state[parent] = (mass + more[0], first + more[1], second + more[2])
    result = [replace(body, inertia=_as_inertia(*s)) for body, s in zip(bodies, state[:-1], strict=True)]
    return result, _as_inertia(*state[-1])


def _moved(
    mass: float, first: Array, second: Array, rotation: Array, translation: Array
) -> tuple[float, Array, Array]:
    """Return a mass distribution in another frame: x -> R x + r.

    Args:
        mass: m [kg].
        first: First moments, shape (3,) [kg m].
        second: Second moments, shape (3, 3) [kg m^2].
        rotation: R, shape (3, 3).
        translation: r, shape (3,) [m].
    """
    turned = product(rotation, first)
    cross = np.outer(translation, turned)
    second = product(product(rotation, second), rotation.T) + cross + cross.T
    second = second + mass * np.outer(translation, translation)
    return mass, turned + mass * translation, second


def _as_arrays(inertia: Inertia) -> tuple[float, Array, Array]:
    """Return mass, first moments of shape (3,) and second moments of shape (3, 3)."""
    return inertia.mass, np.array(inertia.first), np.array(inertia.second)


def _as_inertia(mass: float, first: Array, second: Array) -> Inertia:
    """Return an inertia of a mass [kg] and moments, shapes (3,) [kg m] and (3, 3) [kg m^2]."""
    return Inertia(float(mass), numbers(clean(first)), numbers(clean(second)))
