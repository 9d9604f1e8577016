"""Contacts with friction for one step: the problem, and its solution by Newton's method on velocities.

With velocities u, mass matrix M, free velocities u_f and the four edges of each point's friction pyramid,
whose velocities are y(u), the convex problem is

    minimize (u - u_f)^T M (u - u_f) / 2 + sum over edges of max(0, -y(u))^2 / (2 R).

Coulomb's law takes a few convex problems: friction iterations correct the normal velocities and rotate the
pyramids.

Shapes of inner functions' arrays, for k points, N velocities, n of which belong to the robot, and b free
bodies: J and its responses (3 k, N), M (N, N), velocities u, free and start (N,), rates J u [m/s] and
impulses [N s] (3 k,), bias, share (mu |v_t|, added to the bias) [m/s], friction and compliance (k,), y of the
edges [m/s] and its change (k, 4), columns of the bodies (b,), rows of points, normals and gaps (>= k, 7).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.core.linear_algebra import cholesky, solve_cholesky, solve_cholesky_columns
from pepper_kin.core.simulation.narrow_phase import FREE, ON_ROBOT, BodyTable, ContactPoints, ShapeTable
from pepper_kin.core.simulation.tree_motion import TreeMotion, TreeTable
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.interrupts import call_back
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

RELATIVE_COMPLIANCE = 1e-5
"""R relative to the diagonal of A."""
RECOVERY = 0.2
"""Ratio of an overlap that is removed in one step."""
FASTEST_RECOVERY = 0.2
"""Maximum speed at which overlaps are removed [m/s]."""
IMMOVABLE = 1e-9
"""Maximum speed from an impulse of 1 N s at which a point counts as immovable and does not push [m/s]."""
ALIGNED = 1e-7
"""Sliding speed below which no sliding direction is defined [m/s]."""
ITERATIONS = 60
LINE_STEPS = 40
CONVERGED = 3e-13
"""Change of the contacts' velocities below which Newton's method ends [m/s]."""
FASTEST = 1e6
"""Upper limit of the sum of the free bodies' absolute velocities [m/s and rad/s]."""
FRICTION_ITERATIONS = 10
COULOMB_TOLERANCE = 1e-4  # [m/s], ends friction iterations
SOLVE_PROBLEM = 1
"""First argument of a call-back that computes the impulses of a convex problem."""
ADDRESSES = 16
"""Size of the array that passes addresses and sizes to a call-back."""


class ContactProblem(NamedTuple):
    """Problem of one step, with k points and N velocities: the robot's, if touched, and the touched bodies'.

    Attributes:
        mass: M, shape (N, N).
        free: Velocities without contact [rad/s or m/s], shape (N,).
        start: Velocities before the step, shape (N,).
        jacobian: J, rows normal, first and second tangent of each point, shape (3 k, N).
        response: J M^-1, shape (3 k, N).
        compliance: R of each point's edges, shape (k,).
        bias: Speed that closes the gap, gap / h, or if negative removes an overlap, shape (k,) [m/s].
        friction: mu, shape (k,).
        tangents: First tangent in the world, shape (k, 3).
        columns: First column of each free body, -1 if it touches nothing, shape (b,).
        room: Memory for the solution, see `room_for`.
        sound: Whether the robot's mass matrix is positive definite.
    """

    mass: Floats2
    free: Floats1
    start: Floats1
    jacobian: Floats2
    response: Floats2
    compliance: Floats1
    bias: Floats1
    friction: Floats1
    tangents: Floats2
    columns: Ints1
    room: Floats1
    sound: bool


class FreeStep(NamedTuple):
    """The robot's step without contacts: v+ = v + h mass_hat^-1 force; n is 0 for a robot held still.

    Attributes:
        velocity: Joint velocities [rad/s or m/s], shape (>= n,).
        mass_hat: Mass matrix including implicit terms of the step [kg m^2 or kg], shape (n, n).
        force: Joint forces [N m or N], shape (n,).
    """

    velocity: Floats1
    mass_hat: Floats2
    force: Floats1


class SolverState(NamedTuple):
    """Results of the solver.

    Attributes:
        velocity: u, in the first N [rad/s or m/s], shape (n + 6 b,).
        impulses: Normal, first and second tangent of each point [N s], in the first 3 k, shape
            (3 MOST_POINTS,).
        forces: Forces at the points, in the world's axes [N], shape (MOST_POINTS, 3).
        load: Load of the contacts on the robot [N m or N], shape (n,).
        numbers: k, N, number of convex problems solved, whether a call-back solved them, and number of steps
            in `wrench`, shape (5,).
        coulomb_error: Normal velocity by which sliding contacts deviate from Coulomb's law [m/s], shape (1,).
        addresses: Addresses for the call-back, see `solve_contacts`, shape (ADDRESSES,).
        wrench: Force [N] of the contacts on the robot and moment about the world's origin [N m], in each of
            the last steps, shape (s, 6).
        mail: Arguments of call-backs, shape (3,).
    """

    velocity: Floats1
    impulses: Floats1
    forces: Floats2
    load: Floats1
    numbers: Ints1
    coulomb_error: Floats1
    addresses: Ints1
    wrench: Floats2
    mail: Ints1


def room_for(points: int, velocities: int) -> int:
    """Return the number of floats that a problem of k points and N velocities and its solution need."""
    return 3 * velocities * (velocities + 3 * points) + 10 * velocities + 40 * points + 6


@compiled
def assemble(
    count: int, points: ContactPoints, shapes: ShapeTable, tree: TreeTable, at: TreeMotion, bodies: BodyTable,
    robot: FreeStep, h: float,
) -> ContactProblem:  # fmt: skip
    """Return the contact problem of a step, in the memory of `points`.

    Args:
        count: Number of contact points.
        points: The contact points.
        shapes: The shapes.
        tree: Tree of the robot.
        at: Present poses of the joints.
        bodies: The free bodies.
        robot: The robot's step without contacts.
        h: Length of the step [s].
    """
    columns = points.columns
    n = _number_columns(count, points, shapes, len(robot.force), columns)
    size, rows = n, 3 * count
    for b in range(len(columns)):
        if columns[b] >= 0:
            size += 6
    square, wide, end = size * size, rows * size, 2 * size + 6
    room = points.room
    used = end + square + 2 * wide + 6 * count
    for k in range(used):
        room[k] = 0.0
    free, start, scratch = room[:size], room[size : 2 * size], room[2 * size : end].reshape(2, 3)
    mass = room[end : end + square].reshape(size, size)
    jacobian = room[end + square : end + square + wide].reshape(rows, size)
    response = room[end + square + wide : end + square + 2 * wide].reshape(rows, size)
    end = used - 6 * count
    compliance, bias = room[end : end + count], room[end + count : end + 2 * count]
    friction = room[end + 2 * count : end + 3 * count]
    tangents = room[end + 3 * count : used].reshape(count, 3)
    lower = room[used : used + n * n].reshape(n, n)
    solved = room[used + n * n : used + n * n + n * rows].reshape(n, rows)
    sound = _add_robot(robot, h, lower, mass, free, start)
    _add_bodies(bodies, h, columns, mass, free, start)
    for c in range(count):
        three = jacobian[3 * c : 3 * c + 3]
        for side in range(2):
            s = points.shapes[c, side]
            sign = 1.0 if side == 0 else -1.0
            if shapes.mover[s] == ON_ROBOT and n == 0:
                continue
            place = (shapes.mover[s], shapes.owner[s])
            _add_point_rows(place, points.rows[c, :3], sign, tree, at, bodies, columns, three)
        _turn_to_frame(three, points.rows[c, 3:6], free, tangents[c], scratch)
    _add_responses(jacobian, lower, columns, bodies, solved, response)
    for c in range(count):
        mu = math.sqrt(shapes.friction[points.shapes[c, 0]] * shapes.friction[points.shapes[c, 1]])
        total = 0.0
        for i in range(3):
            row, answer = jacobian[3 * c + i], response[3 * c + i]
            weight = 1.0 if i == 0 else 0.5 * mu * mu
            for k in range(size):
                total += weight * row[k] * answer[k]
        gap = points.rows[c, 6]
        friction[c], compliance[c] = mu, RELATIVE_COMPLIANCE * total
        bias[c] = gap / h if gap >= 0 else max(RECOVERY * gap / h, -FASTEST_RECOVERY)
        if total < IMMOVABLE:
            compliance[c], bias[c] = 1.0, max(bias[c], 0.0)
    return ContactProblem(
        mass,
        free,
        start,
        jacobian,
        response,
        compliance,
        bias,
        friction,
        tangents,
        columns,
        room[used:],
        sound,
    )


@compiled(lean=True)
def _number_columns(count: int, points: ContactPoints, shapes: ShapeTable, n: int, columns: Ints1) -> int:
    """Number the columns of touched free bodies, shape (b,); return the robot's number of columns: n or 0."""
    robot = 0
    for b in range(len(columns)):
        columns[b] = -1
    for c in range(count):
        for side in range(2):
            s = points.shapes[c, side]
            if shapes.mover[s] == ON_ROBOT:
                robot = n
            elif shapes.mover[s] == FREE:
                columns[shapes.owner[s]] = 0
    size = robot
    for b in range(len(columns)):
        if columns[b] == 0:
            columns[b] = size
            size += 6
    return robot


@compiled(lean=True)
def _add_point_rows(
    place: tuple[int, int], point: Floats1, sign: float, tree: TreeTable, at: TreeMotion, bodies: BodyTable,
    columns: Ints1, rows: Floats2,
) -> None:  # fmt: skip
    """Add the Jacobian of a point's velocity, in the world's axes, times `sign`, to rows, shape (3, N).

    `place` has mover and owner of the shape; the point has shape (3,) [m], columns shape (b,).
    """
    mover, owner = place
    if mover == ON_ROBOT:
        joint = owner
        while joint > 0:
            column = tree.driver[joint]
            if column >= 0:
                scale = sign * tree.ratio[joint]
                ax, ay, az = at.axis[joint, 0], at.axis[joint, 1], at.axis[joint, 2]
                if tree.joints[joint, 1] > 0.0:
                    rows[0, column] += scale * ax
                    rows[1, column] += scale * ay
                    rows[2, column] += scale * az
                else:
                    x = point[0] - at.pose[joint, 0]
                    y = point[1] - at.pose[joint, 1]
                    z = point[2] - at.pose[joint, 2]
                    rows[0, column] += scale * (ay * z - az * y)
                    rows[1, column] += scale * (az * x - ax * z)
                    rows[2, column] += scale * (ax * y - ay * x)
            joint = int(tree.joints[joint, 0])
    elif mover == FREE:
        first = columns[owner]
        x, y, z = (
            point[0] - bodies.position[owner, 0],
            point[1] - bodies.position[owner, 1],
            point[2] - bodies.position[owner, 2],
        )
        for i in range(3):
            rows[i, first + i] += sign
        rows[0, first + 4] += sign * z
        rows[0, first + 5] -= sign * y
        rows[1, first + 5] += sign * x
        rows[1, first + 3] -= sign * z
        rows[2, first + 3] += sign * y
        rows[2, first + 4] -= sign * x


@compiled(lean=True)
def _turn_to_frame(rows: Floats2, normal: Floats1, free: Floats1, tangent: Floats1, scratch: Floats2) -> None:
    """Rotate rows, shape (3, N), from the world's axes to normal and tangents.

    The first tangent is along the tangential part of the free velocities, shape (N,), and is output in the
    world's axes, shape (3,), as is the normal.  `scratch` is workspace of shape (2, 3).
    """
    size = rows.shape[1]
    rates, second = scratch[0], scratch[1]
    for i in range(3):
        rates[i] = 0.0
        for k in range(size):
            rates[i] += rows[i, k] * free[k]
    along = rates[0] * normal[0] + rates[1] * normal[1] + rates[2] * normal[2]
    for i in range(3):
        rates[i] -= along * normal[i]
    length = math.sqrt(rates[0] ** 2 + rates[1] ** 2 + rates[2] ** 2)
    if length < ALIGNED:
        axis = 0
        for i in range(1, 3):
            if abs(normal[i]) < abs(normal[axis]) - 1e-6:
                axis = i
        for i in range(3):
            rates[i] = -normal[axis] * normal[i]
        rates[axis] += 1.0
        length = math.sqrt(rates[0] ** 2 + rates[1] ** 2 + rates[2] ** 2)
    for i in range(3):
        tangent[i] = rates[i] / length
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        second[i] = normal[k] * tangent[m] - normal[m] * tangent[k]
    for k in range(size):
        x, y, z = rows[0, k], rows[1, k], rows[2, k]
        rows[0, k] = normal[0] * x + normal[1] * y + normal[2] * z
        rows[1, k] = tangent[0] * x + tangent[1] * y + tangent[2] * z
        rows[2, k] = second[0] * x + second[1] * y + second[2] * z


@compiled(lean=True)
def _add_bodies(
    bodies: BodyTable, h: float, columns: Ints1, mass: Floats2, free: Floats1, start: Floats1
) -> None:
    """Write the free bodies' part of M, free and start over h [s]; shapes as in the module's docstring."""
    rotation, velocity, inertia = bodies.rotation, bodies.velocity, bodies.inertia
    for b in range(len(columns)):
        k = columns[b]
        if k < 0:
            continue
        for i in range(3):
            mass[k + i, k + i] = bodies.mass[b]
            free[k + i] = velocity[b, i] + h * bodies.gravity[b, i]
            free[k + 3 + i] = velocity[b, 3 + i]
            start[k + i], start[k + 3 + i] = velocity[b, i], velocity[b, 3 + i]
            for m in range(3):
                for o in range(3):
                    mass[k + 3 + i, k + 3 + m] += rotation[b, i, o] * inertia[b, o] * rotation[b, m, o]


@compiled(lean=True)
def _add_responses(
    jacobian: Floats2, lower: Floats2, columns: Ints1, bodies: BodyTable, solved: Floats2, response: Floats2
) -> None:
    """Write J M^-1 into zeros, from the Cholesky factor `lower`, shape (n, n), of the robot's part.

    `solved` is workspace of shape (n, 3 k); other shapes are those of the module's docstring.
    """
    n, rotation, inertia = len(lower), bodies.rotation, bodies.inertia
    rows = len(jacobian)
    if n:
        for k in range(n):
            for r in range(rows):
                solved[k, r] = jacobian[r, k]
        solve_cholesky_columns(lower, solved)
        for r in range(rows):
            for k in range(n):
                response[r, k] = solved[k, r]
    for b in range(len(columns)):
        k = columns[b]
        if k < 0:
            continue
        lightness = 1.0 / bodies.mass[b]
        easy = (1.0 / inertia[b, 0], 1.0 / inertia[b, 1], 1.0 / inertia[b, 2])
        for r in range(rows):
            for i in range(3):
                response[r, k + i] = jacobian[r, k + i] * lightness
            for o in range(3):
                turned = 0.0
                for i in range(3):
                    turned += rotation[b, i, o] * jacobian[r, k + 3 + i]
                turned *= easy[o]
                for i in range(3):
                    response[r, k + 3 + i] += rotation[b, i, o] * turned


@compiled(lean=True)
def _add_robot(
    robot: FreeStep, h: float, lower: Floats2, mass: Floats2, free: Floats1, start: Floats1
) -> bool:
    """Write the robot's part of M, free and start, and its Cholesky factor `lower`, shape (n, n).

    Other shapes are those of the module's docstring.  Returns whether the mass matrix is positive definite.
    """
    n, v = len(lower), robot.velocity
    if n == 0:
        return True
    for i in range(n):
        start[i], free[i] = v[i], robot.force[i]
        for k in range(n):
            mass[i, k] = robot.mass_hat[i, k]
    sound = cholesky(robot.mass_hat, lower)
    solve_cholesky(lower, free[:n])
    for k in range(n):
        free[k] = v[k] + h * free[k]
    return sound


@compiled
def solve_contacts(
    problem: ContactProblem, rows: Floats2, callback: int, by_callback: bool, state: SolverState
) -> bool:
    """Solve a step: convex problems by Newton's method, or by a call-back; write velocities and impulses.

    The call-back receives `SOLVE_PROBLEM`, the address of `state.addresses` and a zero.  The array holds k
    and N, the addresses of jacobian, response, free, compliance, bias and friction, and the address of the
    impulses, which the call-back writes; it returns 0, or a negative number on failure.

    Args:
        problem: The problem; its tangents are rotated in place.
        rows: Points, normals and gaps, shape (>= k, 7).
        callback: Address of the call-back, or 0; it is called if Newton's method fails.
        by_callback: Whether the call-back solves in any case.
        state: Output.

    Returns:
        Whether a solution was found.
    """
    for value in problem.free:
        if not math.isfinite(value):
            return False
    count, size = len(problem.bias), len(problem.free)
    u, impulses = state.velocity[:size], state.impulses[: 3 * count]
    state.numbers[0], state.numbers[1] = count, size
    for way in range(1 if by_callback else 0, 2 if callback != 0 else 1):
        state.numbers[3] = way
        if _iterate_friction(problem, rows, callback if way == 1 else 0, u, impulses, state):
            return True
    return False


@compiled
def _iterate_friction(
    problem: ContactProblem, rows: Floats2, callback: int, u: Floats1, impulses: Floats1, state: SolverState
) -> bool:
    """Solve convex problems until Coulomb's law holds to a tolerance; return whether all were solved.

    The call-back at an address solves them, or Newton's method if the address is 0; shapes as in the module's
    docstring.
    """
    count, size, room = len(problem.bias), len(problem.start), problem.room
    end = (3 + size) * size + 15 * count  # workspace of `newton` ends here
    share, shifted, rates = (
        room[end : end + count],
        room[end + count : end + 2 * count],
        room[end + 2 * count : end + 5 * count],
    )
    guess = room[end + 5 * count : end + 5 * count + size]
    _first_share(problem, rates, share)
    for k in range(size):
        guess[k] = problem.start[k]
    state.coulomb_error[0] = 0.0
    for iteration in range(1, FRICTION_ITERATIONS + 1):
        state.numbers[2] = iteration
        for c in range(count):
            shifted[c] = problem.bias[c] + share[c]
        if callback != 0:
            if not _solve_by_callback(problem, shifted, callback, impulses, state):
                return False
        elif newton(problem, shifted, guess, impulses) < 0:
            return False
        _velocities_after(problem, impulses, u)
        state.coulomb_error[0] = _deviation(problem, u, impulses, share, rates)
        if state.coulomb_error[0] <= COULOMB_TOLERANCE:
            return True
        if iteration < FRICTION_ITERATIONS:
            _align_tangents(problem, rows, rates, share, iteration)
    return True


@compiled
def _solve_by_callback(
    problem: ContactProblem, bias: Floats1, callback: int, impulses: Floats1, state: SolverState
) -> bool:
    """Compute the impulses of one convex problem by the call-back; return whether it succeeded.

    `state.addresses` is filled as for `solve_contacts`; shapes as in the module's docstring.
    """
    addresses = state.addresses
    addresses[0], addresses[1] = len(bias), len(problem.free)
    addresses[2], addresses[3] = problem.jacobian.ctypes.data, problem.response.ctypes.data
    addresses[4], addresses[5] = problem.free.ctypes.data, problem.compliance.ctypes.data
    addresses[6], addresses[7] = bias.ctypes.data, problem.friction.ctypes.data
    addresses[8] = impulses.ctypes.data
    return call_with(callback, state.mail, SOLVE_PROBLEM, addresses.ctypes.data, 0) >= 0


@compiled
def call_with(callback: int, mail: Ints1, what: int, first: int, second: int) -> int:
    """Call back with three integers, passed in memory of shape (3,)."""
    mail[0], mail[1], mail[2] = what, first, second
    return call_back(callback)


@compiled
def _first_share(problem: ContactProblem, rates: Floats1, share: Floats1) -> None:
    """Write mu |v_t| of every point before the step, and the rates; shapes as in the module's docstring."""
    multiply(problem.jacobian, problem.start, rates)
    for c in range(len(share)):
        share[c] = problem.friction[c] * math.sqrt(rates[3 * c + 1] ** 2 + rates[3 * c + 2] ** 2)


@compiled(lean=True)
def _velocities_after(problem: ContactProblem, impulses: Floats1, u: Floats1) -> None:
    """Write u = free + M^-1 J^T p for impulses p; shapes as in the module's docstring."""
    for k in range(len(u)):
        u[k] = problem.free[k]
    for r in range(len(impulses)):
        if impulses[r] != 0.0:
            for k in range(len(u)):
                u[k] += problem.response[r, k] * impulses[r]


@compiled(lean=True)
def _deviation(
    problem: ContactProblem, u: Floats1, impulses: Floats1, share: Floats1, rates: Floats1
) -> float:
    """Return the touching points' maximum deviation from Coulomb's law [m/s]; shapes as in the module."""
    multiply(problem.jacobian, u, rates)
    worst = 0.0
    for c in range(len(share)):
        if impulses[3 * c] <= 0.0 and rates[3 * c] + problem.bias[c] > -COULOMB_TOLERANCE:
            continue
        first, second = abs(rates[3 * c + 1]), abs(rates[3 * c + 2])
        length = math.sqrt(first * first + second * second)
        off = problem.friction[c] * (length - max(first, second))
        worst = max(worst, off + abs(problem.friction[c] * length - share[c]))
    return worst


@compiled(lean=True)
def _align_tangents(
    problem: ContactProblem, rows: Floats2, rates: Floats1, share: Floats1, iteration: int
) -> None:
    """Update the velocity bias by the sliding speeds, and rotate the tangents toward the sliding directions.

    A pyramid is symmetric under a quarter turn, so that no rotation exceeds an eighth.  Full steps can
    oscillate; steps that shrink with every iteration do not.  Shapes as in the module's docstring.
    """
    friction, tangents = problem.friction, problem.tangents
    turning = 1.0 / (1 + iteration)
    sharing = 1.0 if iteration < 4 else 0.5
    for c in range(len(friction)):
        a, b = rates[3 * c + 1], rates[3 * c + 2]
        length = math.hypot(a, b)
        share[c] += sharing * (friction[c] * length - share[c])
        if length < COULOMB_TOLERANCE:
            continue
        turn = math.atan2(b, a)
        turn = turning * (turn - 0.5 * math.pi * round(turn / (0.5 * math.pi)))
        a, b = math.cos(turn), math.sin(turn)
        _turn_rows(problem.jacobian, 3 * c + 1, a, b)
        _turn_rows(problem.response, 3 * c + 1, a, b)
        x, y, z = tangents[c, 0], tangents[c, 1], tangents[c, 2]
        nx, ny, nz = rows[c, 3], rows[c, 4], rows[c, 5]
        tangents[c, 0] = a * x + b * (ny * z - nz * y)
        tangents[c, 1] = a * y + b * (nz * x - nx * z)
        tangents[c, 2] = a * z + b * (nx * y - ny * x)


@compiled(lean=True)
def _turn_rows(matrix: Floats2, row: int, a: float, b: float) -> None:
    """Rotate two rows of a matrix, shape (3 k, N), by an angle of cosine a and sine b."""
    for k in range(matrix.shape[1]):
        x, y = matrix[row, k], matrix[row + 1, k]
        matrix[row, k], matrix[row + 1, k] = a * x + b * y, a * y - b * x


@compiled("int64(ContactProblem, float64[::1], float64[::1], float64[::1])")
def newton(problem: ContactProblem, bias: Floats1, u: Floats1, impulses: Floats1) -> int:
    """Minimize (u - free)^T M (u - free) / 2 + sum over edges of max(0, -y(u))^2 / (2 R).

    The cost is convex, once differentiable and piecewise quadratic.  Newton's step with the exact line search
    ends at the exact minimum (up to rounding) once it is taken in full and no edge changes sides.

    Args:
        problem: M, free, J, R and mu.
        bias: Bias including mu |v_t|; see `ContactProblem`, shape (k,) [m/s].
        u: Initial guess; overwritten by the solution, shape (N,).
        impulses: Output, shape (3 k,) [N s].

    Returns:
        Number of iterations; -1 if they did not suffice or the matrix is not positive definite.
    """
    mass, free, jacobian = problem.mass, problem.free, problem.jacobian
    compliance, friction = problem.compliance, problem.friction
    size, rows, count = len(free), len(impulses), len(compliance)
    room = problem.room
    rates, moved = room[:rows], room[rows : 2 * rows]
    y = room[2 * rows : 2 * rows + 4 * count].reshape(count, 4)
    change = room[2 * rows + 4 * count : 2 * rows + 8 * count].reshape(count, 4)
    none, end = room[2 * rows + 8 * count : 2 * rows + 9 * count], 2 * rows + 9 * count
    direction, gradient = room[end : end + size], room[end + size : end + 2 * size]
    deviation = room[end + 2 * size : end + 3 * size]
    hessian = room[end + 3 * size : end + 3 * size + size * size].reshape(size, size)
    for c in range(count):
        none[c] = 0.0
    for iteration in range(ITERATIONS):
        multiply(jacobian, u, rates)
        _edge_velocities(rates, bias, friction, y)
        _edge_impulses(y, compliance, friction, impulses)
        for k in range(size):
            deviation[k] = u[k] - free[k]
        multiply(mass, deviation, gradient)
        _subtract_impulses(jacobian, impulses, gradient)
        for i in range(size):
            for k in range(i + 1):
                hessian[i, k] = mass[i, k]
        _add_active(hessian, jacobian, y, compliance, friction)
        if not cholesky(hessian, hessian):
            return -1
        for k in range(size):
            direction[k] = -gradient[k]
        solve_cholesky(hessian, direction)
        multiply(jacobian, direction, moved)
        fastest = 0.0
        for value in moved:
            fastest = max(fastest, abs(value))
        if fastest < CONVERGED:
            return iteration
        _edge_velocities(moved, none, friction, change)
        if _same_sides(y, change):
            _move(u, 1.0, direction)
            multiply(jacobian, u, rates)
            _edge_velocities(rates, bias, friction, y)
            _edge_impulses(y, compliance, friction, impulses)
            return iteration + 1
        slope, curve = 0.0, 0.0
        multiply(mass, direction, gradient)
        for k in range(size):
            slope += deviation[k] * gradient[k]
            curve += direction[k] * gradient[k]
        _move(u, _length(y, change, compliance, slope, curve), direction)
    return -1


@compiled(lean=True)
def _edge_velocities(rates: Floats1, bias: Floats1, friction: Floats1, result: Floats2) -> None:
    """Write y = v_n +- mu v_t + bias of every point's four edges; shapes as in the module's docstring."""
    for c in range(len(bias)):
        normal = rates[3 * c] + bias[c]
        first, second = friction[c] * rates[3 * c + 1], friction[c] * rates[3 * c + 2]
        result[c, 0], result[c, 1] = normal + first, normal - first
        result[c, 2], result[c, 3] = normal + second, normal - second


@compiled(lean=True)
def _edge_impulses(y: Floats2, compliance: Floats1, friction: Floats1, result: Floats1) -> None:
    """Write the impulses of all points; an edge's is max(0, -y) / R; shapes as in the module's docstring."""
    for c in range(len(compliance)):
        a, b = max(0.0, -y[c, 0]) / compliance[c], max(0.0, -y[c, 1]) / compliance[c]
        d, e = max(0.0, -y[c, 2]) / compliance[c], max(0.0, -y[c, 3]) / compliance[c]
        result[3 * c] = a + b + d + e
        result[3 * c + 1] = friction[c] * (a - b)
        result[3 * c + 2] = friction[c] * (d - e)


@compiled(lean=True)
def _length(y: Floats2, change: Floats2, compliance: Floats1, slope: float, curve: float) -> float:
    """Return the step of minimum cost: the root of the cost's piecewise linear derivative.

    `slope` and `curve` are the first and second derivative of the cost without edges; shapes as in the
    module.
    """
    low, high, step = 0.0, math.inf, 1.0
    for _ in range(LINE_STEPS):
        value, rise = slope + step * curve, curve
        for c in range(len(compliance)):
            for e in range(4):
                now = y[c, e] + step * change[c, e]
                if now < 0:
                    value += now * change[c, e] / compliance[c]
                    rise += change[c, e] ** 2 / compliance[c]
        if value > 0:
            high = step
        else:
            low = step
        better = step - value / rise
        if abs(better - step) <= 1e-14 * step:
            return better
        if not low < better < high:
            better = 0.5 * (low + high) if high < math.inf else 2.0 * step
        step = better
    return step


@compiled(lean=True)
def _add_active(
    hessian: Floats2, jacobian: Floats2, y: Floats2, compliance: Floats1, friction: Floats1
) -> None:
    """Add J_a^T R^-1 J_a of pushing edges to a lower triangle, shape (N, N); other shapes: module."""
    size = len(hessian)
    for c in range(len(compliance)):
        mu, stiff = friction[c], 1.0 / compliance[c]
        first, second = (stiff if y[c, 0] < 0 else 0.0), (stiff if y[c, 1] < 0 else 0.0)
        third, fourth = (stiff if y[c, 2] < 0 else 0.0), (stiff if y[c, 3] < 0 else 0.0)
        nn = first + second + third + fourth
        if nn == 0:
            continue
        n1, n2 = mu * (first - second), mu * (third - fourth)
        t1, t2 = mu * mu * (first + second), mu * mu * (third + fourth)
        a, b, d = jacobian[3 * c], jacobian[3 * c + 1], jacobian[3 * c + 2]
        for i in range(size):
            x = nn * a[i] + n1 * b[i] + n2 * d[i]
            y1 = n1 * a[i] + t1 * b[i]
            y2 = n2 * a[i] + t2 * d[i]
            if x == 0.0 and y1 == 0.0 and y2 == 0.0:
                continue
            for k in range(i + 1):
                hessian[i, k] += x * a[k] + y1 * b[k] + y2 * d[k]


@compiled(lean=True)
def _subtract_impulses(jacobian: Floats2, impulses: Floats1, gradient: Floats1) -> None:
    """Subtract J^T p from a gradient, shape (N,), with J of shape (3 k, N)."""
    for r in range(len(impulses)):
        if impulses[r] != 0.0:
            for k in range(len(gradient)):
                gradient[k] -= jacobian[r, k] * impulses[r]


@compiled(lean=True)
def _move(u: Floats1, step: float, direction: Floats1) -> None:
    """Add a step along a direction to u, shape (N,) each."""
    for k in range(len(u)):
        u[k] += step * direction[k]


@compiled(lean=True)
def _same_sides(y: Floats2, change: Floats2) -> bool:
    """Return whether the same edges push after a change of y, shape (k, 4) each."""
    for c in range(len(y)):
        for e in range(4):
            if (y[c, e] + change[c, e] < 0) != (y[c, e] < 0):
                return False
    return True


@compiled(lean=True)
def multiply(matrix: Floats2, vector: Floats1, result: Floats1) -> None:
    """Write the product, shape (m,), of a matrix, shape (m, n), and a vector, shape (n,)."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for k in range(matrix.shape[1]):
            total += matrix[i, k] * vector[k]
        result[i] = total
