"""One step of a world: finds and solves contacts, moves the free bodies, returns the load on the robot."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pepper_kin.core.simulation.contact_solver import (
    ADDRESSES,
    FASTEST,
    ContactProblem,
    FreeStep,
    SolverState,
    assemble,
    call_with,
    room_for,
    solve_contacts,
)
from pepper_kin.core.simulation.free_bodies import apply_gravity, integrate_bodies
from pepper_kin.core.simulation.narrow_phase import (
    MOST_POINTS,
    WORK_ROWS,
    BodyTable,
    ContactPoints,
    ShapeTable,
    bound_shapes,
    find_contacts,
)
from pepper_kin.core.simulation.tree_motion import TreeMotion, TreeTable, move_joints, tree_motion
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Array, Floats1, Floats2, Ints1, record_of

SOLVED, NOT_SOLVED, TOO_MANY_POINTS, NOT_POSITIVE_DEFINITE, FORCE_NOT_FINITE, NOT_FINITE, CALLBACK_FAILED = (
    range(7)
)
"""Outcomes of a step; after any but the first, the bodies are unchanged."""
NO_WORLD, TABLES, CALLBACK = 0, 1, 2
"""Kinds of world: none, a world of tables, or one whose whole step a call-back computes."""
DECIDE_PAIRS, ADVANCE = 0, 2
"""First arguments of call-backs besides `SOLVE_PROBLEM`: find the points of undecided pairs; compute a whole
step."""


class WorldTables(NamedTuple):
    """Free bodies and contacts around a robot.

    Attributes:
        kind: NO_WORLD, TABLES or CALLBACK.
        callback: Address of `int64 f()`, or 0, which reads `state.mail`.  Called for DECIDE_PAIRS, with the
            numbers of points and of undecided pairs, it adds points and returns their new number; for
            ADVANCE, with the address of `state.addresses` (n, then the addresses of q, v, mass_hat, force
            and load), it writes the load and returns 0.  A negative result is a failure.
        by_callback: Whether the call-back solves the contact problems.
        tree: Tree of the robot.
        at: Poses of the robot's joints, output.
        shapes: All shapes; their poses are output.
        bodies: Free bodies; their states are changed.
        points: Contact points, output.
        state: Results of the solver, output.
    """

    kind: int
    callback: int
    by_callback: bool
    tree: TreeTable
    at: TreeMotion
    shapes: ShapeTable
    bodies: BodyTable
    points: ContactPoints
    state: SolverState


def world_tables(
    tree: TreeTable,
    shapes: ShapeTable,
    bodies: BodyTable,
    *,
    callback: int = 0,
    by_callback: bool = False,
    mail: Ints1 | None = None,
) -> WorldTables:
    """Return the tables of a world, with new arrays for the output of a step."""
    joints = int(tree.driver.max()) + 1
    points = ContactPoints(
        rows=np.zeros((MOST_POINTS, 7)),
        shapes=np.zeros((MOST_POINTS, 2), np.int64),
        undecided=np.zeros((MOST_POINTS, 2), np.int64),
        room=np.empty(room_for(MOST_POINTS, joints + 6 * len(bodies.mass))),
        columns=np.zeros(len(bodies.mass), np.int64),
        work=np.empty((WORK_ROWS, 3)),
    )
    state = SolverState(
        velocity=np.zeros(joints + 6 * len(bodies.mass)),
        impulses=np.zeros(3 * MOST_POINTS),
        forces=np.zeros((MOST_POINTS, 3)),
        load=np.zeros(joints),
        numbers=np.zeros(5, np.int64),
        coulomb_error=np.zeros(1),
        addresses=np.zeros(ADDRESSES, np.int64),
        wrench=np.zeros((1, 6)),
        mail=np.zeros(3, np.int64) if mail is None else mail,
    )
    return WorldTables(TABLES, callback, by_callback, tree, tree_motion(tree), shapes, bodies, points, state)


def no_world(n: int) -> WorldTables:
    """Return tables for a robot of n joints that touches nothing."""

    def empty(kind: type) -> Any:
        fields = [field for _, field in record_of(kind).fields if isinstance(field, Array)]
        return kind(*(np.empty((0,) * field.ndim, field.dtype) for field in fields))

    state = empty(SolverState)._replace(
        load=np.zeros(n), numbers=np.zeros(5, np.int64), addresses=np.zeros(ADDRESSES, np.int64)
    )
    return WorldTables(
        NO_WORLD,
        0,
        False,
        empty(TreeTable),
        empty(TreeMotion),
        empty(ShapeTable),
        empty(BodyTable),
        empty(ContactPoints),
        state,
    )


@compiled("int64(WorldTables, float64[::1], FreeStep, float64)")
def contact_step(world: WorldTables, q: Floats1, robot: FreeStep, h: float) -> int:
    """Advance the free bodies by h, and write the load of contacts on the robot to `world.state`.

    Without contact the robot reaches v + h mass_hat^-1 force; with contact, v + h mass_hat^-1 (force + load).

    Args:
        world: The world.
        q: Position of the robot at the start of the step [rad or m], shape (n,).
        robot: The robot's step without contacts.
        h: Length of the step [s].

    Returns:
        SOLVED, or another outcome.
    """
    if world.kind == CALLBACK:
        return step_by_callback(world, q, robot, h)
    outcome, _ = find_points(world, q, robot.velocity, h, True)
    return outcome if outcome != SOLVED else push_apart(world, robot, h)


@compiled(lean=True)
def find_points(world: WorldTables, q: Floats1, v: Floats1, h: float, robot: bool) -> tuple[int, float]:
    """Write the points in contact, and their number to `world.state`; set the load on the robot to zero.

    Args:
        world: The world.
        q: Position of the robot at the start of the step [rad or m], shape (n,).
        v: Velocity of the robot then [rad/s or m/s], shape (n,).
        h: Length of the step [s].
        robot: Whether the robot may be near anything.

    Returns:
        SOLVED, or another outcome; and a lower bound of the robot's distance from all else [m].
    """
    state, points = world.state, world.points
    state.numbers[0] = 0
    if robot:
        move_joints(world.tree, q, v, world.at)
    bound_shapes(world.shapes, world.at, world.bodies, robot)
    count, undecided, apart = find_contacts(world.shapes, world.at, world.bodies, h, points, robot)
    if count < 0 or count + undecided > len(points.rows):
        return TOO_MANY_POINTS, 0.0
    if undecided > 0:
        count = call_with(world.callback, state.mail, DECIDE_PAIRS, count, undecided)
        if count < 0:
            return CALLBACK_FAILED, 0.0
    state.numbers[0] = count
    for j in range(len(state.load)):
        state.load[j] = 0.0
    for c in range(count):
        for i in range(3):
            state.forces[c, i] = 0.0
    return SOLVED, apart


@compiled
def push_apart(world: WorldTables, robot: FreeStep, h: float) -> int:
    """Complete `contact_step` once points are found; without points the robot's motion is not read.

    Args:
        world: The world.
        robot: The robot's step without contacts.
        h: Length of the step [s].

    Returns:
        SOLVED, or another outcome.
    """
    state, bodies, points = world.state, world.bodies, world.points
    count, free = state.numbers[0], len(bodies.velocity)
    before = points.room[len(points.room) - 6 * free :].reshape(free, 6)
    for b in range(free):
        for i in range(6):
            before[b, i] = bodies.velocity[b, i]
    if count == 0:
        finite = apply_gravity(bodies, h)
    else:
        problem = assemble(count, points, world.shapes, world.tree, world.at, bodies, robot, h)
        if not problem.sound:
            return NOT_POSITIVE_DEFINITE
        if not solve_contacts(problem, points.rows, world.callback, world.by_callback, state):
            return NOT_SOLVED if _is_finite(problem.free) else FORCE_NOT_FINITE
        finite = _apply_solution(problem, points.rows, bodies, h, state)
    if not finite:
        for b in range(free):
            for i in range(6):
                bodies.velocity[b, i] = before[b, i]
        return NOT_FINITE
    integrate_bodies(bodies, h, points.work)
    row = state.numbers[4]
    if row < len(state.wrench):
        _add_wrench(count, world.shapes.of_robot, points, state.forces, state.wrench[row])
        state.numbers[4] = row + 1
    return SOLVED


@compiled(lean=True)
def _add_wrench(count: int, of_robot: Ints1, points: ContactPoints, forces: Floats2, wrench: Floats1) -> None:
    """Add the contact forces on the robot, and their moments about the world's origin, to a wrench.

    Args:
        count: Number of points.
        of_robot: 1 for the robot's shapes, see `ShapeTable`, shape (k,).
        points: The points.
        forces: Forces at the points, in the world, shape (>= count, 3) [N].
        wrench: Force and moment, changed, shape (6,) [N, N m].
    """
    for c in range(count):
        sign = float(of_robot[points.shapes[c, 0]] - of_robot[points.shapes[c, 1]])
        for i in range(3):
            k, m = (i + 1) % 3, (i + 2) % 3
            wrench[i] += sign * forces[c, i]
            wrench[3 + i] += sign * (points.rows[c, k] * forces[c, m] - points.rows[c, m] * forces[c, k])


@compiled(lean=True)
def _apply_solution(
    problem: ContactProblem, rows: Floats2, bodies: BodyTable, h: float, state: SolverState
) -> bool:
    """Write velocities of all bodies and forces of all points, and add the load on the robot.

    Args:
        problem: The solved problem.
        rows: Points, normals and gaps, shape (>= k, 7).
        bodies: The free bodies; their velocities are output.
        h: Length of the step [s].
        state: The solution; forces and load are output.

    Returns:
        Whether all velocities are below `FASTEST` and all loads finite.
    """
    count, velocity, gravity = len(problem.bias), bodies.velocity, bodies.gravity
    u, impulses, load = state.velocity[: len(problem.free)], state.impulses[: 3 * count], state.load
    jacobian, tangents, columns, forces = problem.jacobian, problem.tangents, problem.columns, state.forces
    total, touched = 0.0, len(u)
    for b in range(len(columns)):
        k = columns[b]
        if k >= 0:
            touched -= 6
        for i in range(6):
            if k >= 0:
                velocity[b, i] = u[k + i]
            elif i < 3:
                velocity[b, i] += h * gravity[b, i]
            total += abs(velocity[b, i])
    for c in range(count):
        n, t = rows[c, 3:6], tangents[c]
        for i in range(3):
            k, m = (i + 1) % 3, (i + 2) % 3
            across = n[k] * t[m] - n[m] * t[k]
            forces[c, i] = (
                impulses[3 * c] * n[i] + impulses[3 * c + 1] * t[i] + impulses[3 * c + 2] * across
            ) / h
    if touched:
        for r in range(len(impulses)):
            if impulses[r] != 0.0:
                for k in range(len(load)):
                    load[k] += jacobian[r, k] * impulses[r] / h
        for k in range(len(load)):
            total += 0.0 * load[k]
    return total < FASTEST


@compiled
def step_by_callback(world: WorldTables, q: Floats1, robot: FreeStep, h: float) -> int:
    """Compute a whole step of the robot at q, shape (n,) [rad or m], by the call-back; return the outcome."""
    addresses = world.state.addresses
    addresses[0], addresses[1], addresses[2] = len(q), q.ctypes.data, robot.velocity.ctypes.data
    addresses[3], addresses[4] = robot.mass_hat.ctypes.data, robot.force.ctypes.data
    addresses[5] = world.state.load.ctypes.data
    done = call_with(world.callback, world.state.mail, ADVANCE, addresses.ctypes.data, 0)
    return SOLVED if done >= 0 else CALLBACK_FAILED


@compiled
def _is_finite(values: Floats1) -> bool:
    """Return whether all numbers, shape (k,), are finite."""
    total = 0.0
    for value in values:
        total += 0.0 * value
    return total == 0.0
