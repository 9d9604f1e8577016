"""The world of a twin: free boxes and balls, and contacts among them, the robot and the scene."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision import Scene, SceneObject
from pepper_kin.collision.bodies import check_names
from pepper_kin.core.simulation.contact_solver import ADDRESSES, FASTEST, SOLVE_PROBLEM, FreeStep
from pepper_kin.core.simulation.contact_step import (
    CALLBACK_FAILED,
    FORCE_NOT_FINITE,
    NOT_FINITE,
    NOT_POSITIVE_DEFINITE,
    NOT_SOLVED,
    SOLVED,
    TOO_MANY_POINTS,
    WorldTables,
    contact_step,
    world_tables,
)
from pepper_kin.core.simulation.narrow_phase import MOST_POINTS, ON_ROBOT, BodyTable
from pepper_kin.dynamics import total_mass
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kernels.callback import Callback
from pepper_kin.kernels.intrinsics import floats_at, words_at
from pepper_kin.model import Box, PepperModel, Sphere
from pepper_kin.model.joint_vectors import as_finite, as_joint_vector, refuse_degrees
from pepper_kin.model.shapes import transform
from pepper_kin.twin.contact_error import ContactError
from pepper_kin.twin.world import body_limits
from pepper_kin.twin.world.coal_contacts import CoalContacts
from pepper_kin.twin.world.colliders import colliders
from pepper_kin.twin.world.contact import StepSolution, WorldContact
from pepper_kin.twin.world.free_body import FreeBody, principal_inertia
from pepper_kin.twin.world.proxsuite_solver import SOLVERS, ImpulseProblem, ImpulseProgram, check_solver
from pepper_kin.twin.world.tree import levers_of, tree_table

CAUSES = {
    NOT_SOLVED: "the contact problem was not solved",
    TOO_MANY_POINTS: f"more than {MOST_POINTS} points in contact",
    NOT_POSITIVE_DEFINITE: "the robot's mass matrix is not positive definite",
    FORCE_NOT_FINITE: "the robot's force or velocity is NaN",
    NOT_FINITE: f"velocities became NaN, infinite or faster than {FASTEST:g} m/s or rad/s",
    CALLBACK_FAILED: "a distance could not be computed",
}
GRAVITY = (0.0, 0.0, -9.81)
LONGEST_STEP = 0.05
"""[s]"""
HEAVY = 1e9
"""Of obstacles that move, which nothing stops [kg or kg m^2]."""


class World:
    """Free bodies and contacts, stepped along with a robot or without one.

    See `docs/contacts.md` for the equations.  The robot does not touch itself here, and what the scene allows
    to touch does not push.

    Args:
        pepper: The robot; None for a world without one.
        scene: What stands in the world, and what hangs on the robot; None for nothing.  Obstacles that move
            go on with their velocity from the first step on, push what they meet and are stopped by nothing.
        friction: Coefficient of everything without its own coefficient, from 0 to 100.
        gravity: [m/s^2], shape (3,).
        solver: "compiled", Newton's method in machine code, or "proxsuite", for the same problem.

    Raises:
        InvalidValueError: for a friction below 0 or above 100, NaN, an unknown solver, or an object that is
            named like a link.
        MissingDependencyError: for "proxsuite" where it cannot be loaded.
        UnknownNameError: for frames that the robot lacks.
    """

    _bodies: BodyTable
    _tables: WorldTables
    _solved: bool

    def __init__(
        self,
        pepper: PepperModel | None,
        scene: Scene | None = None,
        *,
        friction: float = 0.6,
        gravity: ArrayLike = GRAVITY,
        solver: str = "compiled",
    ) -> None:
        self.pepper = pepper
        self.scene = scene if scene is not None else Scene()
        if pepper is not None:
            check_names(pepper, self.scene)
        elif self.scene.attached:
            raise InvalidValueError(
                "scene",
                f"{', '.join(self.scene.attached)} attached",
                "nothing attached where there is no robot",
            )
        self.friction = body_limits.check_friction("friction", friction)
        self.gravity = read_only(as_finite(gravity, "gravity", (3,)))
        self._solver = check_solver(solver)
        self._tree = tree_table(pepper)
        self._initial: dict[str, FreeBody] = {}
        self._driven = [self._as_driven(item) for item in self.scene.movers]
        self._program = ImpulseProgram()
        self._callback, self._h = Callback(self._answer), 0.0
        self._rebuild({})

    @property
    def solver(self) -> str:
        """How contacts are solved, "compiled" or "proxsuite"; may be changed between steps."""
        return self._solver

    @solver.setter
    def solver(self, solver: str) -> None:
        """Change how contacts are solved.

        Raises:
            InvalidValueError: for another name than "compiled" or "proxsuite".
            MissingDependencyError: for "proxsuite" where it cannot be loaded.
        """
        self._solver = check_solver(solver)
        self._tables = self._tables._replace(by_callback=self._solver == "proxsuite")

    @property
    def bodies(self) -> Mapping[str, FreeBody]:
        """Name -> free body in its present state, read-only, in the order of addition."""
        states = self._states()
        return MappingProxyType({name: states[name] for name in self._initial})

    def _as_driven(self, item: SceneObject) -> FreeBody:
        """Return an obstacle that moves as a body that nothing stops."""
        if item.path is not None:
            said = "one that stands or has a velocity, as of scene.at(time).standing"
            raise InvalidValueError("scene", f"{item.name!r} along a trajectory", said)
        velocity = np.concatenate([item.velocity, np.zeros(3)])
        heavy = np.full(3, HEAVY)
        pose = item.transform_object_to_world
        return FreeBody(item.name, item.geometry, HEAVY, heavy, self.friction, pose, velocity)

    def levers(self) -> Array:
        """Return how far points of the robot move at most when a joint does [m/rad or 1], shape (n,)."""
        table = self._colliders.table
        radius = np.zeros(len(self._tree.joints))
        for s in np.flatnonzero(table.mover == ON_ROBOT):
            far = float(np.linalg.norm(table.own_middle[s])) + float(table.ball[s, 3])
            radius[table.owner[s]] = max(radius[table.owner[s]], far)
        return levers_of(self.pepper, self._tree, radius)

    def present(self) -> tuple[FreeBody, ...]:
        """Return all bodies, then the obstacles that move, in their present state."""
        return tuple(self._states().values())

    def _states(self) -> dict[str, FreeBody]:
        """Return all bodies, obstacles that move among them, in their present state."""
        found = {}
        for row, body in enumerate([*self._initial.values(), *self._driven]):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self._bodies.rotation[row], self._bodies.position[row]
            found[body.name] = FreeBody(
                body.name,
                body.geometry,
                body.mass,
                body.inertia,
                body.friction,
                pose,
                self._bodies.velocity[row],
            )
        return found

    @property
    def contacts(self) -> tuple[WorldContact, ...]:
        """Points of the last step, those that do not push included."""
        count = int(self._tables.state.numbers[0])
        rows = read_only(self._tables.points.rows[:count])
        forces = read_only(self._tables.state.forces[:count])
        return tuple(
            WorldContact(names, row[:3], row[3:6], float(row[6]), force)
            for names, row, force in zip(self._touching(), rows, forces, strict=True)
        )

    @property
    def last_solution(self) -> StepSolution | None:
        """How the last step was solved; None where nothing touched."""
        state = self._tables.state
        count, size, problems, by_callback, _ = state.numbers.tolist()
        if not (self._solved and count):
            return None
        return StepSolution(
            state.velocity[:size].copy(),
            state.impulses[: 3 * count].copy(),
            SOLVERS[by_callback],
            problems,
            float(state.coulomb_error[0]),
        )

    def add_box(
        self,
        name: str,
        size: ArrayLike,
        mass: float,
        position: ArrayLike,
        rpy: ArrayLike = (0.0, 0.0, 0.0),
        *,
        velocity: ArrayLike = (0.0,) * 6,
        friction: float | None = None,
    ) -> None:
        """Add a free box of even density.

        Args:
            name: A name that neither scene nor robot nor another body has.
            size: Full lengths [m], shape (3,), from 1e-6 to 1e3 each.
            mass: [kg], 1e-15 to 1e6, at most 1e5 times heavier or lighter than other bodies and the robot.
            position: Of its center in the world [m], shape (3,), at most 1e5 each.
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            velocity: Of its center [m/s] and turning [rad/s], in the world, shape (6,), at most 1e5 each.
            friction: Its own coefficient, at most 100; that of the world if omitted.

        Raises:
            InvalidValueError: naming body and quantity, for what is not allowed.
        """
        lengths = as_finite(size, f"size of {name!r}", (3,)).tolist()
        x, y, z = (body_limits.check_size(f"size of {name!r}", length) for length in lengths)
        self._add(name, Box((x, y, z)), mass, transform(*_pose(name, position, rpy)), velocity, friction)

    def add_ball(
        self,
        name: str,
        radius: float,
        mass: float,
        position: ArrayLike,
        *,
        velocity: ArrayLike = (0.0,) * 6,
        friction: float | None = None,
    ) -> None:
        """Add a free solid ball of a radius [m] at a position [m], shape (3,); see `add_box`."""
        shape = Sphere(body_limits.check_size(f"radius of {name!r}", radius, 0.5))
        pose = transform(*_pose(name, position, (0.0, 0.0, 0.0)))
        self._add(name, shape, mass, pose, velocity, friction)

    def place(
        self,
        name: str,
        position: ArrayLike | None = None,
        rpy: ArrayLike | None = None,
        *,
        velocity: ArrayLike | None = None,
    ) -> None:
        """Put a free body at position [m], rpy [rad], shape (3,), velocity, shape (6,); omitted ones stay.

        Raises:
            UnknownNameError: listing the free bodies.
            InvalidValueError: for NaN or a wrong shape.
        """
        if name not in self._initial:
            raise UnknownNameError("free body", name, self._initial)
        row = list(self._initial).index(name)
        new = transform(*_pose(name, np.zeros(3), np.zeros(3) if rpy is None else rpy))
        where, moving = self._bodies.position[row], self._bodies.velocity[row]
        if position is not None:
            where = body_limits.check_position(f"position of {name!r}", position)
        if velocity is not None:
            moving = body_limits.check_velocity(f"velocity of {name!r}", velocity)
        self._bodies.position[row], self._bodies.velocity[row] = where, moving
        if rpy is not None:
            self._bodies.rotation[row] = new[:3, :3]

    def reset(self) -> None:
        """Put every free body where and as fast as it was when it was added."""
        self._rebuild({})

    def copy(self) -> World:
        """Return a world in the same state that goes its own way."""
        twin = World(
            self.pepper, self.scene, friction=self.friction, gravity=self.gravity, solver=self.solver
        )
        twin._initial = dict(self._initial)
        twin._rebuild(self._states())
        twin._step = self._step
        return twin

    def snapshot(self) -> Scene:
        """Return the scene with the free bodies where they are now, as obstacles."""
        if not self._shown:
            return self.scene
        poses = np.zeros((len(self._shown), 4, 4))
        poses[:, :3, :3], poses[:, :3, 3], poses[:, 3, 3] = self._bodies.rotation, self._bodies.position, 1.0
        poses.setflags(write=False)
        objects = dict(self.scene.objects)
        for item, pose in zip(self._shown, poses, strict=True):
            objects[item.name] = item.moved_to(pose)
        return Scene(objects, self.scene.attached, self.scene.allowed)

    def advance(self, q: Array, v: Array, mass_hat: Array, force: Array, h: float) -> Array:
        """Advance the free bodies by h and return what contacts do to the robot.

        Without contact the robot would go to v + h mass_hat^-1 force; with it, it goes to
        v + h mass_hat^-1 (force + load).

        Args:
            q: Position at the start of the step [rad or m], shape (n,).
            v: Velocity then [rad/s or m/s], shape (n,).
            mass_hat: Mass matrix, with what servos take implicitly [kg m^2 or kg], shape (n, n).
            force: Right-hand side [N m or N], shape (n,).
            h: Length of the step [s], above 0 and at most 0.05.

        Returns:
            The load J^T impulses / h [N m or N], shape (n,).

        Raises:
            InvalidValueError: for a step out of range, or a wrong shape.
            ContactError: where the step cannot be solved, naming what was in contact; bodies stay.
        """
        if self.pepper is None or mass_hat.shape != (len(q), len(q)) or len(q) != self.pepper.n:
            robot = "no robot" if self.pepper is None else f"{self.pepper.n} joints"
            raise InvalidValueError("mass_hat", f"shape {mass_hat.shape} with q of {len(q)}", f"{robot}")
        motion = FreeStep(*(np.array(part, dtype=float, order="C") for part in (v, mass_hat, force)))
        return self._advance(np.array(q, dtype=float), motion, h)

    def advance_alone(self, h: float, q: ArrayLike | None = None) -> None:
        """Advance the free bodies by h [s] around a robot that does not move, or without one.

        Args:
            h: Length of the step [s], above 0 and at most 0.05.
            q: Where the robot stands [rad or m], shape (n,); its neutral posture if omitted.

        Raises:
            InvalidValueError: for a step out of range, a q of wrong shape, or NaN.
            ContactError: where the step cannot be solved, naming what was in contact; bodies stay.
        """
        if self.pepper is None:
            if q is not None:
                raise InvalidValueError("q", "joint positions", "None where there is no robot")
            posture = np.zeros(0)
        else:
            posture = self.pepper.neutral() if q is None else as_joint_vector(self.pepper, q, "q")
        still = FreeStep(np.zeros(len(posture)), np.zeros((0, 0)), np.zeros(0))
        self._advance(np.array(posture), still, h)

    def coupling(self) -> World | None:
        """Return what steps this world in compiled code; None where `advance` is overridden."""
        return self if type(self).advance is World.advance else None

    def begin(self, h: float, steps: int = 1) -> WorldTables:
        """Return the tables for steps of length h [s] in compiled code, which `end` follows.

        Args:
            h: Length of the steps [s], above 0 and at most 0.05.
            steps: How many at most.

        Raises:
            InvalidValueError: for a step out of range.
        """
        if not 0.0 < h <= LONGEST_STEP:
            raise InvalidValueError("h", f"{h} s", f"a number in (0, {LONGEST_STEP}] s")
        self._h, state = h, self._tables.state
        state.numbers[4] = 0
        if len(state.wrench) < steps:
            self._tables = self._tables._replace(state=state._replace(wrench=np.zeros((steps, 6))))
        else:
            state.wrench[:steps] = 0.0
        return self._tables

    @property
    def wrench(self) -> Array:
        """Force [N] of all contacts on the robot and moment about the world's origin [N m], in world axes.

        Shape (s, 6), for each of the steps since `begin`: one, or those of the last segment of a run.
        """
        return self._tables.state.wrench[: int(self._tables.state.numbers[4])].copy()

    def raised(self) -> BaseException | None:
        """Return what Python code has raised in steps since the last time, and forget it."""
        return self._callback.raised()

    def end(self, steps: int, outcome: int) -> BaseException | None:
        """Take note of the steps that were taken, and return why there were no more, if there were to be.

        Args:
            steps: How many.
            outcome: Of the step after them if it failed, else SOLVED or below.
        """
        self._step += steps
        self._solved = outcome <= SOLVED
        if self._solved:
            return None
        self._step += 1
        error = self.raised()
        return ContactError(self._step, self._touching(), CAUSES[outcome]) if error is None else error

    def _advance(self, q: Array, motion: FreeStep, h: float) -> Array:
        """Take one step around a robot at q [rad or m], shape (n,), and return the load on it, shape (n,)."""
        outcome = contact_step(self.begin(h), q, motion, h)
        error = self.end(int(outcome == SOLVED), outcome)
        if error is not None:
            raise error
        return self._tables.state.load[: len(motion.force)].copy()

    def _answer(self, what: int, first: int, second: int) -> int:
        """Do what compiled code cannot; see `core.simulation.contact_step.WorldTables`."""
        if what == SOLVE_PROBLEM:
            return self._solve_by_proxsuite(words_at(first, ADDRESSES).tolist())
        points, count = self._tables.points, first
        for i, j in points.undecided[:second].tolist():
            count += self._coal.decide((i, j), self._h, points, count)
        return count

    def _solve_by_proxsuite(self, numbers: list[int]) -> int:
        """Write the impulses of a convex problem; return -1 where they were not found."""
        k, n, jacobian, response, free, compliance, bias, friction, impulses = numbers[:9]
        problem = ImpulseProblem(
            floats_at(jacobian, 3 * k * n).reshape(3 * k, n),
            floats_at(response, 3 * k * n).reshape(3 * k, n),
            floats_at(free, n),
            floats_at(compliance, k),
            floats_at(bias, k),
            floats_at(friction, k),
        )
        found = self._program.solve(problem)
        if found is None:
            return -1
        floats_at(impulses, 3 * k)[:] = found
        return 0

    def _touching(self) -> tuple[tuple[str, str], ...]:
        names, count = self._colliders.names, int(self._tables.state.numbers[0])
        return tuple((names[i], names[j]) for i, j in self._tables.points.shapes[:count].tolist())

    def _add(
        self,
        name: str,
        geometry: Box | Sphere,
        mass: float,
        pose: Array,
        velocity: ArrayLike,
        friction: float | None,
    ) -> None:
        """Add a body of a pose, shape (4, 4), and velocity [m/s, rad/s], shape (6,)."""
        taken = {*self.scene.names, *self._initial, *(self.pepper.frame_names if self.pepper else ())}
        if name in taken:
            raise InvalidValueError("body name", repr(name), "a name that no link, object or body has")
        weight = body_limits.check_mass(f"mass of {name!r}", mass)
        body_limits.check_ratio(name, weight, self._masses())
        rough = (
            self.friction
            if friction is None
            else body_limits.check_friction(f"friction of {name!r}", friction)
        )
        moving = body_limits.check_velocity(f"velocity of {name!r}", velocity)
        inertia = principal_inertia(geometry, weight)
        before = self._states()
        self._initial[name] = FreeBody(name, geometry, weight, inertia, rough, pose, moving)
        self._rebuild(before)

    def _masses(self) -> dict[str, float]:
        robot = {} if self.pepper is None else {"the robot": total_mass(self.pepper)}
        return {repr(body.name): body.mass for body in self._initial.values()} | robot

    def _rebuild(self, present: dict[str, FreeBody]) -> None:
        """Make the tables again, with bodies in their present state where there is one."""
        held = [*self._initial.values(), *self._driven]
        now = [present.get(body.name, body) for body in held]
        poses, free = np.array([body.pose for body in now]).reshape(-1, 4, 4), len(self._initial)
        self._bodies = BodyTable(
            position=np.array([body.position for body in now]).reshape(-1, 3),
            rotation=np.ascontiguousarray(poses[:, :3, :3]),
            velocity=np.array([body.velocity for body in now]).reshape(-1, 6),
            mass=np.array([body.mass for body in held], dtype=float),
            inertia=np.array([body.inertia for body in held]).reshape(-1, 3),
            gravity=np.concatenate([np.tile(self.gravity, (free, 1)), np.zeros((len(held) - free, 3))]),
        )
        self._shown = [
            self.scene.objects.get(body.name) or SceneObject(body.name, body.geometry, body.pose)
            for body in held
        ]
        self._colliders = colliders(self.pepper, self.scene, held, self.friction)
        self._coal = CoalContacts(self._colliders)
        self._tables = world_tables(
            self._tree,
            self._colliders.table,
            self._bodies,
            callback=self._callback.address,
            by_callback=self.solver == "proxsuite",
            mail=self._callback.mail,
        )
        self._solved, self._step = True, 0


def _pose(name: str, position: ArrayLike, rpy: ArrayLike) -> tuple[Array, Array]:
    """Return position [m] and roll, pitch, yaw [rad] of a body, shape (3,) each."""
    angles = as_finite(rpy, f"rpy of {name!r}", (3,))
    refuse_degrees(angles, f"rpy of {name!r}")
    return body_limits.check_position(f"position of {name!r}", position), angles
