"""Kernels of the equation of motion of one step: its terms, and its solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pepper_kin.core.simulation.actuator_model import (
    CREEP,
    drive_segment,
    encoder_reading,
    friction_segment,
    servo_feedback,
    servo_gain,
    speed_torque_line,
)
from pepper_kin.core.simulation.implicit_step import RUNAWAY, SAME_FORCE
from pepper_kin.dynamics.load import PARAMETERS
from pepper_kin.kernels import Kernel, compile_function, host_target, source_digest
from pepper_kin.kernels.compiled_function import CompiledFunction
from pepper_kin.model import PepperModel, robot_digest
from pepper_kin.symbolic.bodies import Inertia
from pepper_kin.symbolic.composite import coupled_entries, mass_entries
from pepper_kin.symbolic.factorization import factorize
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.inverse_dynamics import full_gravity, full_torques
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.scalars import GraphScalar, ScalarGraph, Value
from pepper_kin.symbolic.states import gather, make_state
from pepper_kin.symbolic.tree import Tree, read_tree
from pepper_kin.symbolic.vectors import (
    add,
    add_matrices,
    outer,
    product,
    scale,
    symmetric,
    times,
    transpose,
)
from pepper_kin.twin.pinocchio_step import PythonKernel, pinocchio_steps

if TYPE_CHECKING:
    import casadi

SOURCES = tuple(
    f"pepper_kin.{name}"
    for name in ("twin.step_kernel", "core.simulation.actuator_model", "symbolic", "model", "dynamics.load")
)
"""Modules whose code the kernels depend on."""

_PACKAGE_VECTOR_BYTES = 32

Place = tuple[int, int]

STEP_INPUTS = (
    "position",
    "velocity",
    "position_reference",
    "velocity_reference",
    "feedforward_torque",
    "load",
)
"""Inputs that change from step to step, n values each; `feedforward_torque` is times the strength."""


@dataclass(frozen=True)
class Variant:
    """Features that the step of a robot has to include.

    Attributes:
        motor: Whether to include rotors, friction, torque-speed lines and encoders; else only servos with
            torque limits.
        scaled: Whether the mass that moves with each joint has a factor.
        load_frames: Names of frames with loads.
    """

    motor: bool = False
    scaled: bool = False
    load_frames: tuple[str, ...] = ()


def parameters(variant: Variant) -> tuple[str, ...]:
    """Return the names of the parameters of `ActuatorTable` that the step takes, n values each."""
    servo = ("kp", "kd", "feedforward", "limit", "upper", "lower")
    motor = ("stall", "line", "viscous", "coulomb", "rotor", "resolution")
    return servo + motor if variant.motor else servo


@remembered
def step_function(pepper: PepperModel, variant: Variant) -> casadi.Function:
    """Return one step of the twin on the first guess of segments; see `pepper_kin.twin.Integrator`.

    Inputs are those of `STEP_INPUTS`, then `parameters`, the timestep `h`, and, where the variant has them,
    `scale` (n) and `loads` (PARAMETERS of each frame that carries something).  Outputs:

    * `next`: position, velocity and torque at the end of the step (3 n).
    * `servo`: the actuators' torque demand at w = 0, and `bias`: b (n each).
    * `mass`: the entries of M at `mass_places`.
    * `violation`: not above 0 where the guess was right, that the segments are those at the present
      velocities: no stop touched, no motor clipped or freed, no joint stuck, freed or turned round, nothing
      absurd.

    Args:
        pepper: The robot.
        variant: Features that the step has to include.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        ModelError: naming joints that move no mass.
    """
    import casadi

    n = pepper.n
    names = (*STEP_INPUTS, *parameters(variant))
    x = {name: casadi.SX.sym(name, n) for name in names}
    h = casadi.SX.sym("h")
    more = [casadi.SX.sym("scale", n)] if variant.scaled else []
    if variant.load_frames:
        more.append(casadi.SX.sym("loads", PARAMETERS * len(variant.load_frames)))
    q, v = x["position"], x["velocity"]
    bias, gravity, mass = _terms(pepper, variant)(q, v, *more)
    drive = _drive(x, variant, h, gravity)
    a = solve_function(pepper)(mass, drive.implicit, drive.force - bias)
    after, violation = _ends(x, variant, h, drive, a)
    outputs = [after, drive.servo, bias, mass, violation]
    return casadi.Function("twin_step", [*x.values(), h, *more], outputs)


class _Drive(NamedTuple):
    """Terms of actuators, friction and loads on the segments at the initial velocities of a step.

    Attributes:
        servo: Torque demand of the actuators at w = 0, shape (n,).
        force: Force c - k v + load, shape (n,).
        implicit: Addition J + h k to the diagonal of the mass matrix, shape (n,).
        intercept: Intercept c of the motors' segments, shape (n,).
        slope: Slope k of the motors' segments, shape (n,).
        torque: Function from velocities w to the motors' torques.
    """

    servo: Any
    force: Any
    implicit: Any
    intercept: Any
    slope: Any
    torque: Callable[[Any], Any]


def _drive(x: dict[str, Any], variant: Variant, h: Any, gravity: Any) -> _Drive:
    """Return what the joints' actuators do, by symbols of the step's inputs; gravity: torques at rest."""
    import casadi

    q, v = x["position"], x["velocity"]
    friction, stick, rotor, reading = casadi.SX(0), casadi.SX(0), casadi.SX(0), q
    if variant.motor:
        friction, stick = _traced(friction_segment)(x["coulomb"], v)
        stick, rotor = stick + x["viscous"], x["rotor"]
        reading = _traced(encoder_reading)(x["resolution"], q)
    error = x["position_reference"] - reading
    servo = _traced(servo_feedback)(x["kp"], x["kd"], error, x["velocity_reference"])
    servo += x["feedforward_torque"] + x["feedforward"] * gravity
    gain = _traced(servo_gain)(h, x["kp"], x["kd"])
    motor = x["limit"], x.get("stall", np.inf), x.get("line", 0.0)
    segment = _traced(drive_segment)
    _, intercept, slope = segment(servo, gain, *motor, v)
    force = intercept - friction - (slope + stick) * v + x["load"]
    implicit = h * (slope + stick) + rotor
    return _Drive(servo, force, implicit, intercept, slope, lambda w: segment(servo, gain, *motor, w)[0])


def _ends(x: dict[str, Any], variant: Variant, h: Any, drive: _Drive, a: Any) -> tuple[Any, Any]:
    """Return position, velocity and torque at the end of a step with accelerations a, and the violation."""
    import casadi

    w = x["velocity"] + h * a
    following, torque = x["position"] + h * w, drive.torque(w)
    wrong = casadi.fabs(drive.intercept - drive.slope * w - torque)
    return casadi.vertcat(following, w, torque), _violation(x, variant, following, w, wrong)


@remembered
def drive_functions(pepper: PepperModel, variant: Variant) -> tuple[casadi.Function, casadi.Function]:
    """Return functions of the step's terms before and after its accelerations, which Pinocchio computes.

    The first takes `STEP_INPUTS`, `parameters`, `h` and `gravity` (n) to `force`, `implicit` and `servo`
    (n each); the second the same and accelerations `a` (n) to `next` (3 n) and `violation`, as in
    `step_function`.
    """
    import casadi

    x = {name: casadi.SX.sym(name, pepper.n) for name in (*STEP_INPUTS, *parameters(variant))}
    h, gravity, a = casadi.SX.sym("h"), casadi.SX.sym("gravity", pepper.n), casadi.SX.sym("a", pepper.n)
    drive, inputs = _drive(x, variant, h, gravity), [*x.values(), h, gravity]
    before = [casadi.densify(part) for part in (drive.force, drive.implicit, drive.servo)]
    return (
        casadi.Function("twin_drive", inputs, before),
        casadi.Function("twin_ends", [*inputs, a], list(_ends(x, variant, h, drive, a))),
    )


def _traced(function: CompiledFunction) -> Callable[..., Any]:
    """Return a formula of the actuator model as a function of symbols."""
    import casadi

    meanings = {
        "select": casadi.if_else,
        "floor": casadi.floor,
        "copysign": casadi.copysign,
        "abs": casadi.fabs,
        "min": casadi.fmin,
        "max": casadi.fmax,
    }
    if function is drive_segment:
        meanings["speed_torque_line"] = _traced(speed_torque_line)
    return FunctionType(function.python.__code__, {**function.python.__globals__, **meanings})


def _violation(x: dict[str, Any], variant: Variant, q: Any, w: Any, wrong: Any) -> Any:
    """Return the excess of a step over the segments that it assumed; NaN is passed on.

    Args:
        x: Inputs of the step.
        variant: Features that the step includes.
        q: Positions at the end of the step [rad or m], shape (n,).
        w: Velocities at the end of the step [rad/s or m/s], shape (n,).
        wrong: Differences between the motors' torques and the segments' torques [N m or N], shape (n,).
    """
    import casadi

    old, v = x["position"], x["velocity"]
    violations = [
        casadi.fmax(q, old) - x["upper"],
        x["lower"] - casadi.fmin(q, old),
        casadi.fabs(w) - RUNAWAY,
        wrong - SAME_FORCE,
    ]
    if variant.motor:
        kept = casadi.fabs(w) - CREEP
        turned = CREEP - casadi.copysign(1, v) * w
        violations.append(x["coulomb"] * casadi.if_else(casadi.fabs(v) <= CREEP, kept, turned))
    worst = violations[0][0]
    for values in violations:
        for value in casadi.vertsplit(values):
            worst = casadi.fmax(worst, value)
    return worst + _not_a_number(w)


def _not_a_number(w: Any) -> Any:
    """Return zero for finite values, else NaN, in a form that is not simplified to zero."""
    import casadi

    total = casadi.sum1(w)
    return casadi.if_else(casadi.fabs(total) < np.inf, 0, np.nan)


@remembered
def _terms(pepper: PepperModel, variant: Variant) -> casadi.Function:
    """Return the function (q, v) -> bias, gravity, mass.

    bias is b = C v + g, gravity is g of the robot as it is described, and mass holds the entries of M at
    `mass_places`.  Further inputs are `scale` (n) and `loads`, where the variant has them.
    """
    tree, n = read_tree(pepper, compact=not variant.scaled), pepper.n
    graph = ScalarGraph()
    inputs = {name: graph.inputs(n) for name in ("q", "v")}
    state = make_state(tree, inputs["q"], inputs["v"])
    nominal = gather(tree.full_map, full_gravity(state))
    if variant.scaled:
        inputs["scale"] = graph.inputs(n)
        tree = _scaled(tree, inputs["scale"])
    if variant.load_frames:
        inputs["loads"] = graph.inputs(PARAMETERS * len(variant.load_frames))
        tree = _loaded(tree, variant.load_frames, inputs["loads"])
    state = replace(state, tree=tree)
    bias = gather(tree.full_map, full_torques(state))
    mass = coupled_entries(state, mass_entries(state))
    outputs = {
        "bias": bias,
        "gravity": nominal,
        "mass": [mass[place] for place in sorted(mass)],
    }
    rows = {name: [[value] for value in values] for name, values in outputs.items()}
    return make_function("twin_terms", graph, inputs, rows)


@remembered
def solve_function(pepper: PepperModel) -> casadi.Function:
    """Return the function (mass, extra, right) -> a, the solution of (M + diag(extra)) a = right.

    Args:
        pepper: The robot.

    Returns:
        Function of mass (the entries at `mass_places`), extra and right (n each); output a (n).
    """
    places, graph = mass_places(pepper), ScalarGraph()
    inputs = {
        "mass": graph.inputs(len(places)),
        "extra": graph.inputs(pepper.n),
        "right": graph.inputs(pepper.n),
    }
    entries: dict[Place, Value] = dict(zip(places, inputs["mass"], strict=True))
    a = _solve(entries, inputs["extra"], inputs["right"], pepper.joint_names)
    return make_function("twin_solve", graph, inputs, {"a": [[value] for value in a]})


@remembered
def mass_places(pepper: PepperModel) -> tuple[Place, ...]:
    """Return the places (row, column) of the lower half of M that are not always zero, in order."""
    tree = read_tree(pepper, compact=True)
    state = make_state(tree, ScalarGraph().inputs(pepper.n))
    return tuple(sorted(coupled_entries(state, mass_entries(state))))


def step_kernels(
    pepper: PepperModel, variant: Variant, robots: int
) -> tuple[Kernel | PythonKernel, Kernel | PythonKernel]:
    """Return `step_function` and `solve_function` as machine code, from disk if it is there, or by Pinocchio.

    Both have the same number of lanes.  Many robots are worth the widest vectors of the processor; for one,
    the width that comes with the package will do.
    """
    width = host_target().vector_bytes if robots > 1 else _PACKAGE_VECTOR_BYTES

    def compiled(function: Callable[[], casadi.Function], what: str) -> Kernel:
        return compile_function(function, key=_key(pepper, what), vector_bytes=width, batch=False)

    if pepper.solvers != "fast":
        before = compiled(lambda: drive_functions(pepper, variant)[0], f"twin drive 0 {variant}")
        after = compiled(lambda: drive_functions(pepper, variant)[1], f"twin drive 1 {variant}")
        return pinocchio_steps(pepper, variant, before, after, mass_places(pepper))
    step = compiled(lambda: step_function(pepper, variant), f"twin step {variant}")
    return step, compiled(lambda: solve_function(pepper), "twin solve")


def _solve(
    mass: dict[Place, Value], extra: Sequence[Value], right: Sequence[Value], names: Sequence[str]
) -> list[Value]:
    entries = dict(mass)
    for j, value in enumerate(extra):
        entries[j, j] = entries.get((j, j), 0.0) + value
    return factorize(entries, names).solve(right)


def _scaled(tree: Tree, factors: Sequence[GraphScalar]) -> Tree:
    """Return the tree with every body's mass multiplied by the factor of the joint that moves it."""
    bodies = []
    for i, body in enumerate(tree.bodies):
        factor = factors[int(abs(tree.full_map[i]).argmax())]
        inertia = Inertia(
            factor * body.inertia.mass,  # type: ignore[arg-type]
            scale(factor, body.inertia.first),
            tuple(scale(factor, row) for row in body.inertia.second),
        )
        bodies.append(replace(body, inertia=inertia))
    return replace(tree, bodies=tuple(bodies))


def _loaded(tree: Tree, frames: Sequence[str], loads: Sequence[GraphScalar]) -> Tree:
    """Return the tree with loads at frames, by their parameters: m, h and Sigma about the frames' origins.

    In the axes of the body, of which R turns those of the frame and p is its origin, Sigma about the body's
    origin is R Sigma R^T + p (R h)^T + (R h) p^T + m p p^T.
    """
    bodies = list(tree.bodies)
    for k, frame in enumerate(frames):
        body, turn, place = tree.anchor(frame)
        if body < 0:
            continue  # a frame on the floor does not move
        mass, *first, xx, xy, xz, yy, yz, zz = loads[PARAMETERS * k : PARAMETERS * (k + 1)]
        own, offset, old = times(turn, first), scale(mass, place), bodies[body].inertia
        second = product(product(turn, symmetric(xx, yy, zz, xy, xz, yz)), transpose(turn))
        for moved in (outer(own, place), outer(place, own), outer(offset, place)):
            second = add_matrices(second, moved)
        inertia = Inertia(
            old.mass + mass,  # type: ignore[arg-type]
            add(old.first, offset, own),
            add_matrices(old.second, second),
        )
        bodies[body] = replace(bodies[body], inertia=inertia)
    return replace(tree, bodies=tuple(bodies))


def _key(pepper: PepperModel, what: str) -> str:
    """Return the key of compiled code: the robot, the quantity and the source of the expressions."""
    return f"{what} of {robot_digest(pepper)} by {source_digest(*SOURCES)} {RUNAWAY} {CREEP} {SAME_FORCE}"
