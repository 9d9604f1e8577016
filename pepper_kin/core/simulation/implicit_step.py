"""One timestep: semi-implicit Euler on articulated bodies, with all joint forces implicit.

With step h, position q, velocity v, bias b(q, v) = C(q, v) v + g(q) and the force F_j(v_j+) of actuator,
friction and stop on each joint at the end of the step (see `actuator_model`):

    v+ = v + h a,   q+ = q + h v+                     (semi-implicit, or symplectic, Euler)
    (M(q) + J) a + b(q, v) = F(v+) + load             (J: rotors; servo, friction and stops implicit)

As no F_j increases, the step minimizes the strictly convex, piecewise quadratic function
(w - v)^T (M + J) (w - v) / 2h + (b - load)^T w - sum of integrals of F_j, and so has exactly one solution.
It is found by Newton's method: solve on the segments at the present velocities, take the segments at the
solution, and repeat until they agree; mostly at once, as saturation rarely changes from step to step.
From the fourth round on, an exact line search towards the new guess minimizes the function, after which the
method ends in finitely many rounds.

Robots are arranged in blocks of W lanes, as many as a vector register holds (1 for a single robot).  Joint
j of the robot in lane l of a block is element e = j W + l; m = n W.  The kernel `RobotTables.step_kernel`
computes the first guess.

Source: Hairer, Lubich and Wanner, Geometric Numerical Integration (2006), I.1.2 and VI.3; Featherstone,
Rigid Body Dynamics Algorithms (2008), table 7.1; Sun, On piecewise quadratic Newton and trust region
problems, Mathematical Programming 76 (1997), for the finite number of rounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.core.simulation.actuator_model import (
    COULOMB,
    KD,
    KP,
    LIMIT,
    LINE,
    ROTOR,
    STALL,
    VISCOUS,
    drive_segment,
    friction_segment,
    segment_at,
    select,
    servo_gain,
    when_turned,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import call_kernel
from pepper_kin.kernels.signatures import Flags2, Floats1, Floats2, Floats3, Ints2

RUNAWAY = 1e4
"""Speed of a joint that only divergence reaches [rad/s or m/s]."""
NEWTON_ROUNDS = 4
"""Number of rounds after which the step to the next guess uses a line search."""
MOST_ROUNDS = 60
MOST_SEARCHED, NARROW = 50, 1e-15
"""Maximum number of points of the line search, and width of the bracket, relative to the step, that ends
it."""
SAME_FORCE = 1e-9
"""Tolerance of the force between actuator model and equation of motion, absolute [N m or N] and relative."""


class RobotTables(NamedTuple):
    """N robots of one kind in B blocks of W lanes.

    Attributes:
        timestep: h [s].
        lanes: W.
        step_kernel: Address of the kernel of a step on the first guess.
        solve_kernel: Address of the kernel that solves (M + diag(extra)) a = right.
        law: Parameters of the joints, one row for each of `ActuatorTable`, and, if any joint has backlash or
            heats up, the rows of `drive_state`, shape (B, rows, m).
        constant: Constant part of the step kernel's input, shape (B, c).
        places: Row and column of each entry of the mass matrix, shape (2, p).
    """

    timestep: float
    lanes: int
    step_kernel: int
    solve_kernel: int
    law: Floats3
    constant: Floats2
    places: Ints2


class StepWorkspace(NamedTuple):
    """Arrays of one thread; n joints, W lanes, m = n W, p entries of the mass matrix.

    Attributes:
        step_input: Input of the step kernel, beginning with position, velocity, references, feed-forward,
            load (m each), then constants, shape (6 m + ...,).
        step_output: Output of the step kernel: next position, velocity and torque, servo, bias (m each), mass
            (p W), violation (W), shape (5 m + p W + W,).
        work: Workspace of the kernels, shape (>= work_size,).
        solve_input: Input of the solving kernel: mass, extra and right, shape (p W + 2 m,).
        solve_output: Output of the solving kernel, shape (m,).
        rows: Intercept and slope of each joint's segment, velocities of the round before, (M + J) times the
            step to the next guess, (M + J) times the change so far, 1 where a lane is open, and the error of
            the forces, shape (7, m).
        flags: Which lanes have converged, and which robots continue, shape (2, W).
    """

    step_input: Floats1
    step_output: Floats1
    work: Floats1
    solve_input: Floats1
    solve_output: Floats1
    rows: Floats2
    flags: Flags2


# Parts of `step_input` and `step_output`, m values each.
Q, V, Q_REF, V_REF, FEEDFORWARD_TORQUE, LOAD, CONSTANT = 0, 1, 2, 3, 4, 5, 6
CONSTANT_LIMIT = CONSTANT + 3  # torque limits, the fourth constant
NEXT_Q, NEXT_V, TORQUE, SERVO, BIAS, MASS = 0, 1, 2, 3, 4, 5
# Rows of `rows` and `flags`.
INTERCEPT, SLOPE, BEFORE, WAY, GONE, OPEN, WRONG = range(7)
CONVERGED, ALIVE = 0, 1


@compiled(lean=True)
def implicit_step(block: int, robots: RobotTables, space: StepWorkspace) -> bool:
    """Take a step of a block from `step_input`; return whether the first guess was right for all lanes.

    Args:
        block: Index of the block.
        robots: The robots.
        space: Input and workspace; `step_output` receives the new state.
    """
    step_input, step_output, lanes = space.step_input, space.step_output, robots.lanes
    call_kernel(robots.step_kernel, step_input.ctypes.data, step_output.ctypes.data, space.work.ctypes.data)
    calm, first = True, step_output.size - lanes
    for lane in range(lanes):
        calm = calm and step_output[first + lane] <= 0.0  # False for NaN
    if not calm:
        _solve_complementarity(robots, robots.law[block], space)
    return calm


@compiled(lean=True)
def is_sound(lane: int, lanes: int, space: StepWorkspace) -> bool:
    """Return whether the new state of a lane is slower than `RUNAWAY` and finite."""
    m, step_output = space.solve_output.size, space.step_output
    for e in range(lane, m, lanes):
        if not (abs(step_output[NEXT_V * m + e]) < RUNAWAY and abs(step_output[TORQUE * m + e]) < np.inf):
            return False
    return True


@compiled(lean=True)
def all_sound(space: StepWorkspace) -> bool:
    """Return whether `is_sound` holds for all lanes, in one vectorized pass."""
    m, step_output, wrong = space.solve_output.size, space.step_output, 0
    for e in range(m):
        good = abs(step_output[NEXT_V * m + e]) < RUNAWAY and abs(step_output[TORQUE * m + e]) < np.inf
        wrong += 0 if good else 1
    return wrong == 0


@compiled(lean=True)
def write_equation(
    b: int, lane: int, robots: RobotTables, space: StepWorkspace, mass_hat: Floats2, force: Floats1
) -> None:
    """Write the step of a robot as one linear equation, mass_hat a = force.

    mass_hat = M + J + h diag(k) and force = c - k v - b + load on the segments on which the step was solved,
    as written by `write_segments`.

    Args:
        b: Index of the robot's block.
        lane: Lane of the robot.
        robots: The robots.
        space: Arrays of the step.
        mass_hat: Output, shape (n, n) [kg m^2 or kg].
        force: Output, shape (n,) [N m or N].
    """
    n, m, lanes, h, law = len(force), space.solve_output.size, robots.lanes, robots.timestep, robots.law[b]
    step_input, step_output = space.step_input, space.step_output
    for i in range(n):
        for j in range(n):
            mass_hat[i, j] = 0.0
    for p in range(robots.places.shape[1]):
        i, j = robots.places[0, p], robots.places[1, p]
        mass_hat[i, j] = mass_hat[j, i] = step_output[MASS * m + p * lanes + lane]
    for j in range(n):
        e = j * lanes + lane
        slope = space.rows[SLOPE, e]
        mass_hat[j, j] += law[ROTOR, e] + h * slope
        pull = space.rows[INTERCEPT, e] - slope * step_input[V * m + e] - step_output[BIAS * m + e]
        force[j] = pull + step_input[LOAD * m + e]


@compiled(lean=True)
def write_segments(b: int, robots: RobotTables, space: StepWorkspace) -> None:
    """Write the segments on which a step of block b was solved, for lanes whose first guess was right."""
    m, h, law, lanes = space.solve_output.size, robots.timestep, robots.law[b], robots.lanes
    violation = space.step_output.size - lanes
    for lane in range(lanes):
        if not space.step_output[violation + lane] <= 0.0:  # other lanes have been written
            continue
        for e in range(lane, m, lanes):
            v, servo = space.step_input[V * m + e], space.step_output[SERVO * m + e]
            gain = servo_gain(h, law[KP, e], law[KD, e])
            _, c, k = drive_segment(servo, gain, law[LIMIT, e], law[STALL, e], law[LINE, e], v)
            friction, stick = friction_segment(law[COULOMB, e], v)
            space.rows[INTERCEPT, e] = c - friction
            space.rows[SLOPE, e] = k + law[VISCOUS, e] + stick


@compiled(lean=True)
def _solve_complementarity(robots: RobotTables, law: Floats2, space: StepWorkspace) -> None:
    """Complete a step whose first guess is wrong: find segments on which actuator model and motion agree.

    Lanes whose first guess is right keep it.  Other lanes continue with the segments at the velocities of the
    first guess.

    Args:
        robots: The robots.
        law: Parameters of the block, shape (rows, m).
        space: Arrays of the step; `step_output` holds the first guess, and receives the result.
    """
    m, h, lanes = space.solve_output.size, robots.timestep, robots.lanes
    violation, rows, step_output = space.step_output.size - lanes, space.rows, space.step_output
    for lane in range(lanes):
        right = step_output[violation + lane] <= 0.0
        space.flags[CONVERGED, lane] = right
        rows[OPEN, lane] = 0.0 if right else 1.0
    for e in range(lanes, m):
        rows[OPEN, e] = rows[OPEN, e - lanes]
    _look_up(h, False, law, space)
    entries = robots.places.shape[1] * lanes
    for p in range(entries):
        space.solve_input[p] = space.step_output[MASS * m + p]
    for round_ in range(1, MOST_ROUNDS):
        _next_guess(robots, law, space)
        _look_up(h, round_ < NEWTON_ROUNDS, law, space)
        if _all_agree(lanes, space):
            return
        if round_ >= NEWTON_ROUNDS:
            for lane in range(lanes):
                if not space.flags[CONVERGED, lane]:
                    _line_search(lane, robots, law, space)
            _look_up(h, False, law, space)


@compiled(lean=True)
def _look_up(h: float, turns: bool, law: Floats2, space: StepWorkspace) -> None:
    """Write the torques and segments at the present velocities of open lanes, all at once.

    The error of the forces on the segments before, beyond the tolerance, is written to `rows`.

    Args:
        h: Timestep [s].
        turns: Whether joints that have reversed since the round before get the segment of sticking.
        law: Parameters of the block, shape (rows, m).
        space: Arrays of the step, changed.
    """
    m, rows, step_input, step_output = (
        space.solve_output.size,
        space.rows,
        space.step_input,
        space.step_output,
    )
    for e in range(m):
        w, is_open = step_output[NEXT_V * m + e], rows[OPEN, e] > 0.0
        torque, c, k = segment_at(law, e, h, step_input[e], w, step_output[SERVO * m + e])
        due = rows[INTERCEPT, e] - rows[SLOPE, e] * w
        off = abs(c - k * w - due) - SAME_FORCE * (1.0 + abs(due))
        more_c, more_k = when_turned(law[COULOMB, e], w, select(turns, rows[BEFORE, e], w))
        rows[WRONG, e] = select(is_open, off, -1.0)
        step_output[TORQUE * m + e] = select(is_open, torque, step_output[TORQUE * m + e])
        rows[INTERCEPT, e] = select(is_open, c + more_c, rows[INTERCEPT, e])
        rows[SLOPE, e] = select(is_open, k + more_k, rows[SLOPE, e])


@compiled(lean=True)
def _all_agree(lanes: int, space: StepWorkspace) -> bool:
    """Mark lanes whose forces were right as converged; return whether all lanes have converged."""
    m, all_agree, wrong = space.solve_output.size, True, 0
    for e in range(m):  # vectorized: mostly all are right
        wrong += 0 if space.rows[WRONG, e] <= 0.0 else 1
    if wrong == 0:
        return True
    for lane in range(lanes):
        if space.flags[CONVERGED, lane]:
            continue
        agrees = True
        for e in range(lane, m, lanes):
            agrees = agrees and space.rows[WRONG, e] <= 0.0  # False for NaN
        if agrees:
            space.flags[CONVERGED, lane] = True
            for e in range(lane, m, lanes):
                space.rows[OPEN, e] = 0.0
        all_agree = all_agree and agrees
    return all_agree


@compiled(lean=True)
def _next_guess(robots: RobotTables, law: Floats2, space: StepWorkspace) -> None:
    """Solve the step on the present segments for lanes that have not converged; `law` has shape (rows, m)."""
    m, h, lanes = space.solve_output.size, robots.timestep, robots.lanes
    start = robots.places.shape[1] * lanes
    for e in range(m):
        c, k = space.rows[INTERCEPT, e], space.rows[SLOPE, e]
        force = c - k * space.step_input[V * m + e] + space.step_input[LOAD * m + e]
        space.solve_input[start + e] = law[ROTOR, e] + h * k
        space.solve_input[start + m + e] = force - space.step_output[BIAS * m + e]
    call_kernel(
        robots.solve_kernel,
        space.solve_input.ctypes.data,
        space.solve_output.ctypes.data,
        space.work.ctypes.data,
    )
    step_input, step_output = space.step_input, space.step_output
    for e in range(m):
        is_open, before = space.rows[OPEN, e] > 0.0, step_output[NEXT_V * m + e]
        w = step_input[V * m + e] + h * space.solve_output[e]
        space.rows[BEFORE, e] = select(is_open, before, space.rows[BEFORE, e])
        step_output[NEXT_V * m + e] = select(is_open, w, before)
        step_output[NEXT_Q * m + e] = select(is_open, step_input[e] + h * w, step_output[NEXT_Q * m + e])


@compiled(lean=True)
def _line_search(lane: int, robots: RobotTables, law: Floats2, space: StepWorkspace) -> None:
    """Move a lane's new guess back to the minimum of the step's convex function; `law`: shape (rows, m)."""
    m, step_input, step_output, rows = (
        space.solve_output.size,
        space.step_input,
        space.step_output,
        space.rows,
    )
    h, lanes = robots.timestep, robots.lanes
    _weigh(lane, robots, law, space)
    slope, curvature = 0.0, 0.0
    for e in range(lane, m, lanes):
        way = step_output[NEXT_V * m + e] - rows[BEFORE, e]
        slope += way * (rows[GONE, e] / h + step_output[BIAS * m + e] - step_input[LOAD * m + e])
        curvature += way * rows[WAY, e] / h
    # The derivative increases piecewise linearly: Newton's method, or bisection where it leaves the bracket.
    low, high, t = 0.0, 1.0, 1.0
    for _ in range(MOST_SEARCHED):
        rise, steep = slope + t * curvature, curvature
        for e in range(lane, m, lanes):
            way = step_output[NEXT_V * m + e] - rows[BEFORE, e]
            w = rows[BEFORE, e] + t * way
            _, c, k = segment_at(law, e, h, step_input[e], w, step_output[SERVO * m + e])
            rise -= way * (c - k * w)
            steep += way * way * k
        if rise < 0.0:
            low = t
        else:
            high = t
        ahead = t - rise / steep if steep > 0.0 else low
        if not low < ahead < high:
            ahead = (low + high) / 2
        if high - low < NARROW or abs(ahead - t) < NARROW:
            break
        t = ahead
    for e in range(lane, m, lanes):
        w = rows[BEFORE, e] + t * (step_output[NEXT_V * m + e] - rows[BEFORE, e])
        step_output[NEXT_V * m + e] = w
        step_output[NEXT_Q * m + e] = step_input[e] + h * w


@compiled(lean=True)
def _weigh(lane: int, robots: RobotTables, law: Floats2, space: StepWorkspace) -> None:
    """Write (M + J) (w+ - w) and (M + J) (w - v): w+ is the new guess, w the last; law: shape (rows, m)."""
    m, step_input, step_output, rows = (
        space.solve_output.size,
        space.step_input,
        space.step_output,
        space.rows,
    )
    lanes, places = robots.lanes, robots.places
    for e in range(lane, m, lanes):
        rows[WAY, e] = law[ROTOR, e] * (step_output[NEXT_V * m + e] - rows[BEFORE, e])
        rows[GONE, e] = law[ROTOR, e] * (rows[BEFORE, e] - step_input[V * m + e])
    for p in range(places.shape[1]):
        mass = space.solve_input[p * lanes + lane]
        i, j = places[0, p] * lanes + lane, places[1, p] * lanes + lane
        rows[WAY, i] += mass * (step_output[NEXT_V * m + j] - rows[BEFORE, j])
        rows[GONE, i] += mass * (rows[BEFORE, j] - step_input[V * m + j])
        if i != j:
            rows[WAY, j] += mass * (step_output[NEXT_V * m + i] - rows[BEFORE, i])
            rows[GONE, j] += mass * (rows[BEFORE, i] - step_input[V * m + i])
