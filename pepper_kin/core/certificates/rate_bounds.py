"""Bounds on second derivatives of torques, forces and speeds; see `pepper_kin.trajectory.examined_states`.

A bound on a vector and its derivatives is a row x_0 ... x_k; sums of vectors have the sums of the rows, and
products those of Leibniz, (x y)_k = sum_i C(k, i) x_i y_{k-i}.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Floats3, Ints1

TURNING, UNIT, ORIGIN, LINK = 0, 4, 9, 14
"""Offsets into a link's bounds: angular velocity, orders 0 to 3; a unit vector fixed in it, 0 to 4; its
joint's origin, 0 to 4 (order 0 is unused); and the total size."""
FORCE, MOMENT, WRENCH = 0, 3, 6
"""Offsets into the bounds of a joint's wrench: force and moment about its origin, orders 0 to 2; total
size."""


class Chain(NamedTuple):
    """J joints, the universe first, parents before children, and M masses.

    Attributes:
        parents: Parent of each joint, shape (J,).
        places: Index of each joint's coordinate, shape (J,).
        slides: Whether a joint is prismatic, shape (J,).
        lengths: Distance from the parent's origin to the joint's own at zero [m], shape (J,).
        armature: Armature of each coordinate [kg m^2 or kg], shape (J - 1,).
        carriers: Joint that carries each mass, shape (M,).
        masses: Mass [kg], distance of its center from the joint's origin [m], and norm of its inertia about
            the center [kg m^2], shape (M, 3).
        gravity: Magnitude of gravity [m/s^2].
    """

    parents: Ints1
    places: Ints1
    slides: Flags1
    lengths: Floats1
    armature: Floats1
    carriers: Ints1
    masses: Floats2
    gravity: float


@compiled(lean=True, inline=True)
def _choices(k: int, i: int) -> float:
    """Return the binomial coefficient C(k, i), k <= 4."""
    if i == 0 or i == k:
        return 1.0
    if i == 1 or i == k - 1:
        return float(k)
    return 6.0


@compiled(lean=True)
def _product(first: Floats1, second: Floats1, order: int, out: Floats1) -> None:
    """Write bounds on a product up to an order, shape (order + 1,); `out` must not overlap a factor."""
    for k in range(order + 1):
        total = 0.0
        for i in range(k + 1):
            total += _choices(k, i) * first[i] * second[k - i]
        out[k] = total


@compiled(lean=True)
def _outward(chain: Chain, rates: Floats2, links: Floats2, work: Floats2) -> None:
    """Write the bounds of all links, parents first; `rates` has bounds of the coordinates, shape (n, 5)."""
    for k in range(LINK):
        links[0, k] = 0.0
    links[0, UNIT] = 1.0
    for i in range(1, chain.parents.size):
        above, own, moves = links[chain.parents[i]], links[i], rates[chain.places[i]]
        for k in range(5):
            own[ORIGIN + k] = above[ORIGIN + k] + chain.lengths[i] * above[UNIT + k]
        _product(above[UNIT:], moves if chain.slides[i] else moves[1:], 4 if chain.slides[i] else 3, work[0])
        if chain.slides[i]:
            for k in range(4):
                own[TURNING + k] = above[TURNING + k]
            for k in range(5):
                own[UNIT + k] = above[UNIT + k]
                own[ORIGIN + k] += work[0, k]
            continue
        for k in range(4):
            own[TURNING + k] = above[TURNING + k] + work[0, k]
        own[UNIT] = 1.0
        for k in range(4):
            own[UNIT + k + 1] = 0.0
            for of in range(k + 1):
                own[UNIT + k + 1] += _choices(k, of) * own[TURNING + of] * own[UNIT + k - of]


@compiled(lean=True)
def _inward(chain: Chain, rates: Floats2, links: Floats2, wrenches: Floats2, work: Floats2) -> None:
    """Write bounds on the wrenches of all joints, tips first; shapes: see `bound_rates` for one segment."""
    for i in range(chain.parents.size):
        for k in range(WRENCH):
            wrenches[i, k] = 0.0
    arm, force, tensor, moment = work[0], work[1], work[2], work[3]
    for b in range(chain.carriers.size):
        link, carried = links[chain.carriers[b]], wrenches[chain.carriers[b]]
        mass, lever, inertia = chain.masses[b, 0], chain.masses[b, 1], chain.masses[b, 2]
        for k in range(5):
            arm[k] = lever * link[UNIT + k]
        for k in range(3):
            force[k] = mass * (link[ORIGIN + 2 + k] + arm[2 + k])
        force[0] += mass * chain.gravity
        # |R I R^T|_k <= lambda sum C(k, l) |R|_l |R|_{k-l}, and N is the derivative of R I R^T omega
        _product(link[UNIT:], link[UNIT:], 3, tensor)
        _product(tensor, link[TURNING:], 3, moment)
        for k in range(3):
            carried[FORCE + k] += force[k]
            carried[MOMENT + k] += inertia * moment[k + 1]
        _product(arm, force, 2, moment)
        for k in range(3):
            carried[MOMENT + k] += moment[k]
    for i in range(chain.parents.size - 1, 0, -1):
        parent = chain.parents[i]
        for k in range(5):
            arm[k] = chain.lengths[i] * links[parent, UNIT + k]
        if chain.slides[i]:
            _product(links[parent, UNIT:], rates[chain.places[i]], 4, force)
            for k in range(5):
                arm[k] += force[k]
        _product(arm, wrenches[i], 2, moment)
        for k in range(3):
            wrenches[parent, FORCE + k] += wrenches[i, FORCE + k]
            wrenches[parent, MOMENT + k] += wrenches[i, MOMENT + k] + moment[k]


@compiled("void(Chain, float64[:, :, ::1], float64[:, :, ::1], float64[:, :, ::1], float64[:, ::1])")
def bound_rates(chain: Chain, rates: Floats3, links: Floats3, wrenches: Floats3, torques: Floats2) -> None:
    """Write bounds on the torque's second derivative in each segment of a motion.

    Args:
        chain: The joints and masses.
        rates: Bounds on |d^k q / dt^k|, k = 0 ... 4, shape (m, n, 5).
        links: Output, bounds of the links, shape (m, J, LINK).
        wrenches: Output, bounds of the joints' wrenches, shape (m, J, WRENCH).
        torques: Output, bounds on d2 tau / dt2 [N m/s^2 or N/s^2], shape (m, n).
    """
    work = np.empty((4, 5))
    for p in range(rates.shape[0]):
        _outward(chain, rates[p], links[p], work)
        _inward(chain, rates[p], links[p], wrenches[p], work)
        for i in range(1, chain.parents.size):
            place = chain.places[i]
            carried = wrenches[p, i, (FORCE if chain.slides[i] else MOMENT) :]
            _product(links[p, chain.parents[i], UNIT:], carried, 2, work[0])
            torques[p, place] = work[0, 2] + chain.armature[place] * rates[p, place, 4]
