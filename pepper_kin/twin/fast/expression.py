"""What machine code computes in every step: the terms of the equation of motion, and its solution."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING

from pepper_kin.kernels import Kernel, compile_function
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.bodies import Inertia
from pepper_kin.symbolic.composite import coupled_entries, first_moments, mass_entries
from pepper_kin.symbolic.factorization import factorize
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.inverse_dynamics import full_torques
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.scalars import Graph, Scalar, Value
from pepper_kin.symbolic.states import State, gather, make_state
from pepper_kin.symbolic.tree import Tree, read_tree
from pepper_kin.symbolic.vectors import add, add_matrices, outer, scale

if TYPE_CHECKING:
    import casadi

Place = tuple[int, int]


@remembered
def step_function(
    pepper: PepperModel, scaled: bool = False, payload_frames: tuple[str, ...] = ()
) -> casadi.Function:
    """Return the function (q, v, force, extra, share) -> a, bias, gravity, mass.

    a solves (M(q) + diag(extra)) a = force + share * g(q) - b(q, v); bias is b = C v + g, gravity is g of the
    robot as it is described, and mass holds the entries of M at `mass_places`.

    Args:
        pepper: The robot.
        scaled: Whether there is an input `scale` (n): all mass that moves with a joint, but not with those
            further out, is multiplied by it.
        payload_frames: Frames with a point mass; there is an input `payload` [kg] with one value for each.

    Returns:
        Function of q, v, force, extra, share (n each); outputs a, bias, gravity (n) and mass.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        ModelError: naming joints that move no mass.
    """
    tree, n = read_tree(pepper, compact=not scaled), pepper.n
    graph = Graph()
    inputs = {name: graph.inputs(n) for name in ("q", "v", "force", "extra", "share")}
    state = make_state(tree, inputs["q"], inputs["v"])
    nominal = gather(tree.full_map, _gravity(state))
    if scaled:
        inputs["scale"] = graph.inputs(n)
        tree = _scaled(tree, inputs["scale"])
    if payload_frames:
        inputs["payload"] = graph.inputs(len(payload_frames))
        tree = _loaded(tree, payload_frames, inputs["payload"])
    state = replace(state, tree=tree)
    bias = gather(tree.full_map, full_torques(state))
    mass = coupled_entries(state, mass_entries(state))
    right = [
        force + share * gravity - b
        for force, share, gravity, b in zip(inputs["force"], inputs["share"], nominal, bias, strict=True)
    ]
    outputs = {
        "a": _solve(mass, inputs["extra"], right, pepper.joint_names),
        "bias": bias,
        "gravity": nominal,
        "mass": [mass[place] for place in sorted(mass)],
    }
    rows = {name: [[value] for value in values] for name, values in outputs.items()}
    return make_function("twin_step", graph, inputs, rows)


@remembered
def solve_function(pepper: PepperModel) -> casadi.Function:
    """Return the function (mass, extra, right) -> a, the solution of (M + diag(extra)) a = right.

    Args:
        pepper: The robot.

    Returns:
        Function of mass (the entries at `mass_places`), extra and right (n each); output a (n).
    """
    places, graph = mass_places(pepper), Graph()
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
    state = make_state(tree, Graph().inputs(pepper.n))
    return tuple(sorted(coupled_entries(state, mass_entries(state))))


def step_kernel(pepper: PepperModel, scaled: bool = False, payload_frames: tuple[str, ...] = ()) -> Kernel:
    """Return `step_function` as machine code, from the cache on disk if it is there."""
    key = _key(pepper, f"twin step {scaled} {payload_frames}")
    return compile_function(lambda: step_function(pepper, scaled, payload_frames), key=key)


def solve_kernel(pepper: PepperModel) -> Kernel:
    """Return `solve_function` as machine code, from the cache on disk if it is there."""
    return compile_function(lambda: solve_function(pepper), key=_key(pepper, "twin solve"))


def _solve(
    mass: dict[Place, Value], extra: Sequence[Value], right: Sequence[Value], names: Sequence[str]
) -> list[Value]:
    entries = dict(mass)
    for j, value in enumerate(extra):
        entries[j, j] = entries.get((j, j), 0.0) + value
    return factorize(entries, names).solve(right)


def _gravity(state: State) -> list[Value]:
    """Return g of all coordinates of `pinocchio_model`; see `pepper_kin.symbolic.gravity_torque`."""
    tree = state.tree
    moments, masses, _ = first_moments(state)
    pulls: list[Sequence[Value]] = []
    tau: list[Value] = []
    for body, turn, (x, y, _), mass in zip(tree.bodies, state.turns, moments, masses, strict=True):
        pull = turn.inward(pulls[body.parent] if body.parent >= 0 else tree.gravity)
        pulls.append(pull)
        tau.append(-mass * pull[2] if body.slides else y * pull[0] - x * pull[1])
    return tau


def _scaled(tree: Tree, factors: Sequence[Scalar]) -> Tree:
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


def _loaded(tree: Tree, frames: Sequence[str], masses: Sequence[Scalar]) -> Tree:
    """Return the tree with a point mass at the origin of each frame."""
    bodies = list(tree.bodies)
    for frame, mass in zip(frames, masses, strict=True):
        body, _, place = tree.anchor(frame)
        if body < 0:
            continue  # on the floor it moves with nothing
        old = bodies[body].inertia
        lever = scale(mass, place)
        inertia = Inertia(
            old.mass + mass,  # type: ignore[arg-type]
            add(old.first, lever),
            add_matrices(old.second, outer(lever, place)),
        )
        bodies[body] = replace(bodies[body], inertia=inertia)
    return replace(tree, bodies=tuple(bodies))


def _key(pepper: PepperModel, what: str) -> str:
    """Name what the code depends on: the robot, the quantity and the source of the expressions."""
    return f"{what} of {_robot_digest(pepper)} by {_source_digest()}"


@lru_cache(maxsize=32)
def _robot_digest(pepper: PepperModel) -> str:
    content = pepper.urdf + pepper.pinocchio_model.saveToString()
    return hashlib.sha256(content.encode()).hexdigest()


@lru_cache(maxsize=1)
def _source_digest() -> str:
    digest = hashlib.sha256((files("pepper_kin.twin.fast") / "expression.py").read_bytes())
    for room in ("symbolic", "model"):
        for file in sorted(files(f"pepper_kin.{room}").iterdir(), key=lambda f: f.name):
            if file.name.endswith(".py"):
                digest.update(file.read_bytes())
    return digest.hexdigest()
