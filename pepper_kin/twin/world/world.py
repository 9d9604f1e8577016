"""The world of a twin: free boxes and balls, and contacts among them, the robot and the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import Scene, SceneObject
from pepper_kin.collision.bodies import check_names
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import Box, PepperModel, Sphere
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_choice, check_positive
from pepper_kin.model.shapes import read_only, transform
from pepper_kin.twin.command import Command
from pepper_kin.twin.contact_error import ContactError
from pepper_kin.twin.integrator import Series, nothing_done
from pepper_kin.twin.world.colliders import FREE, Colliders, colliders, place_shapes
from pepper_kin.twin.world.free_body import FreeBody, fly, principal_inertia
from pepper_kin.twin.world.march import March
from pepper_kin.twin.world.march_loop import Bodies
from pepper_kin.twin.world.outcome import apply, fall
from pepper_kin.twin.world.problem import ContactProblem, assemble
from pepper_kin.twin.world.programme import ImpulseProgramme
from pepper_kin.twin.world.search import MOST_POINTS, ContactSearch
from pepper_kin.twin.world.step import SOLVERS, StepSolution, solve_step
from pepper_kin.twin.world.tree import Tree, TreeState, place

if TYPE_CHECKING:
    from pepper_kin.twin.fast.single import SingleRobot

Array = NDArray[np.float64]

GRAVITY = (0.0, 0.0, -9.81)
LONGEST_STEP = 0.05
"""[s]"""


@dataclass(frozen=True, eq=False)
class WorldContact:
    """A point where two things touched, or could have, during the last step.  Arrays are read-only.

    Attributes:
        names: Links of the robot or objects; what moves more freely comes first.
        point: In the world [m], shape (3,).
        normal: Unit vector from the second to the first, shape (3,).
        gap: Between the surfaces before the step [m], below zero where they overlap.
        force: On the first, during the step [N], shape (3,); on the second it is the opposite.
    """

    names: tuple[str, str]
    point: Array
    normal: Array
    gap: float
    force: Array

    def __post_init__(self) -> None:
        for name in ("point", "normal", "force"):
            if getattr(self, name).flags.writeable:
                object.__setattr__(self, name, read_only(getattr(self, name)))


class World:
    """Free bodies and contacts, stepped along with a robot or without one.

    See `docs/contacts.md` for the equations.  The robot does not touch itself here, and what the scene allows
    to touch does not push.

    Args:
        pepper: The robot; None for a world without one.
        scene: What stands in the world, and what hangs on the robot; None for nothing.
        friction: Coefficient of everything that is not given its own, at least 0.
        gravity: [m/s^2], shape (3,).
        solver: "compiled", Newton's method in machine code, or "proxsuite", for the same problem.

    Raises:
        InvalidValueError: for a friction below 0, NaN, an unknown solver, or objects named like links.
        UnknownNameError: for frames that the robot lacks.
    """

    _position: Array
    _rotation: Array
    _velocity: Array
    _mass: Array
    _inertia: Array
    _rough: Array
    _table: Colliders
    _search: ContactSearch
    _march: March
    _rows: Array
    _pairs_now: NDArray[np.int64]
    _forces: Array
    _solution: StepSolution | None
    _step: int

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
        self.friction = _friction("friction", friction)
        self.gravity = read_only(as_finite(gravity, "gravity", (3,)))
        self.solver = check_choice("solver", solver, SOLVERS)
        self._weight = np.array(self.gravity)
        self._tree = Tree.of(pepper)
        self._state = TreeState.of(self._tree)
        self._initial: dict[str, FreeBody] = {}
        self._programme = ImpulseProgramme()
        self._still = (np.zeros(0), np.zeros((0, 0)), np.zeros(0))
        self._rebuild({})

    @property
    def bodies(self) -> Mapping[str, FreeBody]:
        """Name -> free body in its present state, read-only, in the order of addition."""
        found = {}
        for row, body in enumerate(self._initial.values()):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self._rotation[row], self._position[row]
            found[body.name] = FreeBody(
                body.name, body.geometry, body.mass, body.inertia, body.friction, pose, self._velocity[row]
            )
        return MappingProxyType(found)

    @property
    def contacts(self) -> tuple[WorldContact, ...]:
        """Points of the last step, those that do not push included."""
        rows, forces = read_only(self._rows), read_only(self._forces)
        return tuple(
            WorldContact(names, row[:3], row[3:6], float(row[6]), force)
            for names, row, force in zip(self._touching(), rows, forces, strict=True)
        )

    @property
    def last_solution(self) -> StepSolution | None:
        """How the last step was solved; None where nothing touched."""
        return self._solution

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
            size: Full lengths [m], shape (3,).
            mass: [kg], above 0.
            position: Of its centre in the world [m], shape (3,).
            rpy: Roll, pitch and yaw about fixed axes [rad], shape (3,).
            velocity: Of its centre [m/s] and of its turning [rad/s], in the world, shape (6,).
            friction: Its own coefficient; that of the world if omitted.

        Raises:
            InvalidValueError: naming body and quantity, for what is not allowed.
        """
        x, y, z = as_finite(size, f"size of {name!r}", (3,)).tolist()
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
        """Add a free solid ball of a radius [m]; see `add_box`."""
        shape = Sphere(check_positive(f"radius of {name!r}", radius, "m"))
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
        """Put a free body somewhere; what is omitted stays.

        Raises:
            UnknownNameError: listing the free bodies.
            InvalidValueError: for NaN or a wrong shape.
        """
        if name not in self._initial:
            raise UnknownNameError("free body", name, self._initial)
        row = list(self._initial).index(name)
        new = transform(*_pose(name, np.zeros(3), np.zeros(3) if rpy is None else rpy))
        where, moving = self._position[row], self._velocity[row]
        if position is not None:
            where = as_finite(position, f"position of {name!r}", (3,))
        if velocity is not None:
            moving = as_finite(velocity, f"velocity of {name!r}", (6,))
        self._position[row], self._velocity[row] = where, moving
        if rpy is not None:
            self._rotation[row] = new[:3, :3]

    def reset(self) -> None:
        """Put every free body where and as fast as it was when it was added."""
        self._rebuild({})

    def copy(self) -> World:
        """Return a world in the same state that goes its own way."""
        twin = World(
            self.pepper, self.scene, friction=self.friction, gravity=self.gravity, solver=self.solver
        )
        twin._initial = dict(self._initial)
        twin._rebuild(dict(self.bodies))
        twin._step = self._step
        return twin

    def snapshot(self) -> Scene:
        """Return the scene with the free bodies where they are now, as obstacles."""
        objects = dict(self.scene.objects)
        for row, body in enumerate(self._initial.values()):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self._rotation[row], self._position[row]
            objects[body.name] = SceneObject(body.name, body.geometry, pose)
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
        moving, matrix, pull = (np.array(part, dtype=float, order="C") for part in (v, mass_hat, force))
        return self._advance(np.array(q, dtype=float), (moving, matrix, pull), h)

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
            posture = self.pepper.neutral() if q is None else as_joint_vectors(self.pepper, q, "q")
            if posture.ndim != 1:
                raise InvalidValueError("q", f"shape {posture.shape}", f"shape ({self.pepper.n},)")
        self._advance(np.array(posture), self._still, h)

    def march(self, robot: SingleRobot, q: Array, v: Array, command: Command, load: Array) -> Series:
        """Advance together with a robot by a step for each command, as far as machine code alone goes.

        This is what a twin asks for before it asks for `advance`; the numbers are the same.

        Args:
            robot: The robot's step in machine code.
            q: Position at the start [rad or m], shape (n,).
            v: Velocity then, shape (n,).
            command: For each step, shape (T, n) each.
            load: Torque from elsewhere [N m or N], shape (T, n), or (1, n) for all steps.

        Returns:
            The states after the steps taken: fewer rows than commands, or none, where the next step needs
            `advance`.
        """
        overridden = getattr(self.advance, "__func__", None) is not World.advance
        if self.solver != "compiled" or overridden or not 0.0 < robot.timestep <= LONGEST_STEP:
            return nothing_done(len(q))
        series, steps = self._march.run(robot, q, v, command, load)
        self._step += steps
        if steps:
            self._rows, self._pairs_now, self._forces, self._solution = self._march.found()
        return series

    def _advance(self, q: Array, robot: tuple[Array, Array, Array], h: float) -> Array:
        if not 0.0 < h <= LONGEST_STEP:
            raise InvalidValueError("h", f"{h} s", f"a number in (0, {LONGEST_STEP}] s")
        self._step += 1
        table, state, moving = self._table, self._state, robot[0]
        place(self._tree, state, q, moving if len(moving) else np.zeros(len(q)))
        place_shapes(
            table.mover, table.index, table.own_rotation, table.own_position, table.ball, state.rotation,
            state.position, state.linear, state.angular, self._rotation, self._position, self._velocity,
            table.rotation, table.position, table.middle, table.speed,
        )  # fmt: skip
        count = self._search.run(h)
        if count < 0:
            raise ContactError(self._step, (), f"more than {MOST_POINTS} points in contact")
        self._rows, self._pairs_now = self._search.rows[:count], self._search.shapes[:count]
        self._forces, self._solution = np.zeros((count, 3)), None
        load = np.zeros(len(moving))
        before = self._velocity.copy()
        finite = self._contact(robot, h, load) if count else fall(self._velocity, self._weight, h)
        if not finite:
            self._velocity[:] = before
            raise ContactError(self._step, self._touching(), "velocities became infinite or NaN")
        fly(self._position, self._rotation, self._velocity, self._inertia, h)
        return load

    def _contact(self, robot: tuple[Array, Array, Array], h: float, load: Array) -> bool:
        """Solve the contacts; write velocities, forces and load, return whether they are finite."""
        table, tree, state = self._table, self._tree, self._state
        problem = ContactProblem(
            *assemble(
                (len(self._rows), self._rows, self._pairs_now),
                (table.mover, table.index, self._rough),
                (tree.parent, tree.slides, tree.driver, tree.ratio, state.position, state.axis),
                (self._position, self._rotation, self._velocity, self._mass, self._inertia),
                robot,
                self._weight,
                h,
            )
        )
        if not problem.sound:
            cause = "the robot's mass matrix is not positive definite"
            raise ContactError(self._step, self._touching(), cause)
        solution = solve_step(problem, self._rows, self.solver, self._programme)
        if solution is None:
            finite = np.isfinite(problem.free).all()
            cause = "the contact problem was not solved" if finite else "the robot's force or velocity is NaN"
            raise ContactError(self._step, self._touching(), cause)
        self._solution = solution
        return apply(
            solution.velocity, solution.impulses, problem.jacobian, self._rows, problem.tangents,
            problem.columns, self._weight, h, self._velocity, self._forces, load,
        )  # fmt: skip

    def _touching(self) -> tuple[tuple[str, str], ...]:
        names = self._table.names
        return tuple((names[i], names[j]) for i, j in self._pairs_now.tolist())

    def _add(
        self,
        name: str,
        geometry: Box | Sphere,
        mass: float,
        pose: Array,
        velocity: ArrayLike,
        friction: float | None,
    ) -> None:
        taken = {*self.scene.names, *self._initial, *(self.pepper.frame_names if self.pepper else ())}
        if name in taken:
            raise InvalidValueError("body name", repr(name), "a name that no link, object or body has")
        weight = check_positive(f"mass of {name!r}", mass, "kg")
        rough = self.friction if friction is None else _friction(f"friction of {name!r}", friction)
        moving = as_finite(velocity, f"velocity of {name!r}", (6,))
        inertia = principal_inertia(geometry, weight)
        before = dict(self.bodies)
        self._initial[name] = FreeBody(name, geometry, weight, inertia, rough, pose, moving)
        self._rebuild(before)

    def _rebuild(self, present: dict[str, FreeBody]) -> None:
        """Make the tables anew, with bodies in their present state where one is given."""
        held = list(self._initial.values())
        now = [present.get(body.name, body) for body in held]
        self._position = np.array([body.position for body in now]).reshape(-1, 3)
        poses = np.array([body.pose for body in now]).reshape(-1, 4, 4)
        self._rotation = np.ascontiguousarray(poses[:, :3, :3])
        self._velocity = np.array([body.velocity for body in now]).reshape(-1, 6)
        self._mass = np.array([body.mass for body in held])
        self._inertia = np.array([body.inertia for body in held]).reshape(-1, 3)
        free = tuple((body.name, body.geometry) for body in held)
        self._table = colliders(self.pepper, self.scene, free)
        own = np.array([body.friction for body in held])
        self._rough = np.full(len(self._table.names), self.friction)
        self._rough[self._table.mover == FREE] = own
        self._search = ContactSearch(self._table)
        bodies = Bodies(
            self._position, self._rotation, self._velocity, self._mass, self._inertia, self._weight
        )
        self._march = March(self._tree, self._state, self._table, self._rough, bodies)
        self._rows, self._forces = np.zeros((0, 7)), np.zeros((0, 3))
        self._pairs_now = np.zeros((0, 2), np.int64)
        self._solution = None
        self._step = 0


def _friction(quantity: str, value: float) -> float:
    number = float(as_finite(value, quantity, ()))
    if number < 0:
        raise InvalidValueError(quantity, value, "a number of at least 0")
    return number


def _pose(name: str, position: ArrayLike, rpy: ArrayLike) -> tuple[Array, Array]:
    return as_finite(position, f"position of {name!r}", (3,)), as_finite(rpy, f"rpy of {name!r}", (3,))
