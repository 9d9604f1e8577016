"""Composite bodies: each body with all its descendants, as if their joints were locked."""

from __future__ import annotations

from pepper_kin.symbolic.bodies import Inertia
from pepper_kin.symbolic.motion import to_parent
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import StateExpressions
from pepper_kin.symbolic.vectors import Vector, add, add_matrices, outer, scale, transpose


def composite_inertias(state: StateExpressions) -> tuple[list[Inertia], Inertia]:
    """Return the inertia of every composite body, and of all moving bodies about the world's origin.

    With x = r + R x_c for the points of a child, h += R h_c + m r and
    Sigma += R Sigma_c R^T + r (R h_c)^T + (R h_c) r^T + m r r^T.
    """
    bodies = state.tree.bodies
    totals = [body.inertia for body in bodies]
    world = state.tree.ground
    for i in reversed(range(len(bodies))):
        r = state.translations[i]
        turned = state.turns[i].outward(totals[i].first)
        mixed = outer(r, add(turned, scale(totals[i].mass / 2.0, r)))
        second = add_matrices(
            state.turns[i].outward_symmetric(totals[i].second), add_matrices(mixed, transpose(mixed))
        )
        first = add(turned, scale(totals[i].mass, r))
        parent = bodies[i].parent
        onto = totals[parent] if parent >= 0 else world
        joined = Inertia(
            onto.mass + totals[i].mass, add(onto.first, first), add_matrices(onto.second, second)
        )
        if parent >= 0:
            totals[parent] = joined
        else:
            world = joined
    return totals, world


def first_moments(state: StateExpressions) -> tuple[list[Vector], list[float], Vector]:
    """Return h and mass of every composite body, and h of all moving bodies about the world's origin."""
    bodies = state.tree.bodies
    moments = [body.inertia.first for body in bodies]
    masses = [body.inertia.mass for body in bodies]
    world = state.tree.ground.first
    for i in reversed(range(len(bodies))):
        first = add(state.turns[i].outward(moments[i]), scale(masses[i], state.translations[i]))
        parent = bodies[i].parent
        if parent >= 0:
            moments[parent] = add(moments[parent], first)
            masses[parent] += masses[i]
        else:
            world = add(world, first)
    return moments, masses, world


def unit_wrench(slides: bool, inertia: Inertia) -> tuple[Vector, Vector]:
    """Return the wrench that accelerates a composite body by one along its joint: force, moment."""
    x, y, _ = inertia.first
    if slides:
        return (0.0, 0.0, inertia.mass), (y, -x, 0.0)
    (xx, _, xz), (_, yy, yz) = inertia.second[:2]
    return (-y, x, 0.0), (-xz, -yz, xx + yy)


def mass_entries(state: StateExpressions) -> dict[tuple[int, int], Value]:
    """Return M_ij of the coordinates of `pinocchio_model` for every body i and each ancestor j.

    Walker and Orin (1982): the wrench of a unit acceleration of joint i is propagated inward; its component
    along the axis of each joint on the way is an entry.
    """
    tree = state.tree
    entries: dict[tuple[int, int], Value] = {}
    for i, inertia in enumerate(composite_inertias(state)[0]):
        force, torque = unit_wrench(tree.bodies[i].slides, inertia)
        j = i
        while j >= 0:
            entries[i, j] = force[2] if tree.bodies[j].slides else torque[2]
            force, torque = to_parent(state, j, force, torque)
            j = tree.bodies[j].parent
        entries[i, i] = entries[i, i] + tree.armature[i]
    return entries


def coupled_entries(
    state: StateExpressions, entries: dict[tuple[int, int], Value]
) -> dict[tuple[int, int], Value]:
    """Return the lower half of E^T M E from M's lower half; entries that are always zero are left out."""
    rows = state.tree.full_map.tolist()
    gains = [[(k, gain) for k, gain in enumerate(row) if gain] for row in rows]
    result: dict[tuple[int, int], Value] = {}
    for (i, j), value in entries.items():
        for a, gain_a in gains[i]:
            for b, gain_b in gains[j]:
                place = (max(a, b), min(a, b))
                # The entry above the diagonal has the same value.
                twice = 2.0 if i != j and a == b else 1.0
                result[place] = result.get(place, 0.0) + (twice * gain_a * gain_b) * value
    return {place: value for place, value in result.items() if not isinstance(value, float) or value}


def symmetric_rows(entries: dict[tuple[int, int], Value], n: int) -> list[list[Value]]:
    """Return all rows of a symmetric matrix from its lower half."""
    return [[entries.get((max(i, j), min(i, j)), 0.0) for j in range(n)] for i in range(n)]
