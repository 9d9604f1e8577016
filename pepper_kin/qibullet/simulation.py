"""Simulations by qiBullet's client number, with their robots and bodies."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pepper_kin.collision import Scene
from pepper_kin.exceptions import shortened
from pepper_kin.model.poses import rpy_of
from pepper_kin.qibullet.bodies import Standing
from pepper_kin.qibullet.errors import SimulationError, UnsimulatedError

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body
    from pepper_kin.naoqi.body_page import BodyPage
    from pepper_kin.qibullet.pepper_virtual import PepperVirtual

TIME_STEP = 1.0 / 240.0
"""Timestep of Bullet and of `stepSimulation` [s]."""

EARTH = (0.0, 0.0, -9.81)
"""Gravity when a simulation is launched [m/s^2]."""


class Simulation:
    """A simulation: robots, obstacles around them, and gravity.

    Args:
        client: Number of the simulation.
        auto_step: Whether the wall clock drives it; otherwise `step` does.
        gui: Whether a browser page shows each robot.
        scene: Obstacles around the robots.

    Attributes:
        gravity: Gravity [m/s^2], three numbers.
        light: Position of the light [m], three numbers, or None.
        robots: Robots by the number of their model.
        bodies: Bodies that `pybullet` has added, by number.
    """

    def __init__(self, client: int, auto_step: bool, gui: bool, scene: Scene | None) -> None:
        self.client, self.auto_step, self.gui, self.scene = client, auto_step, gui, scene
        self.gravity: list[float] = list(EARTH)
        self.light: list[float] | None = None
        self.robots: dict[int, PepperVirtual] = {}
        self.bodies: dict[int, Standing] = {}
        self._own_scene = scene
        self._next = 0
        self._pages: dict[int | None, BodyPage] = {}

    def add(self, robot: PepperVirtual) -> int:
        """Add a robot; return the number of its model."""
        number = self.new_number()
        self.robots[number] = robot
        return number

    def new_number(self) -> int:
        """Return a new number for a robot or a body."""
        self._next += 1
        return self._next

    def body(self, number: int) -> Standing:
        """Return the body with a number.

        Raises:
            SimulationError: for an unknown number.
        """
        if number not in self.bodies:
            known = ", ".join(map(str, self.bodies)) or "(none)"
            got = shortened(repr(number))
            raise SimulationError(f"no body {got} in simulation {self.client}; there are: {known}")
        return self.bodies[number]

    def robot(self, model: int) -> PepperVirtual:
        """Return the robot with a model's number.

        Raises:
            SimulationError: for an unknown number.
        """
        if model not in self.robots:
            known = ", ".join(map(str, self.robots)) or "(none)"
            raise SimulationError(
                f"no robot {shortened(repr(model))} in simulation {self.client}; there are: {known}"
            )
        return self.robots[model]

    def show(self, robot: PepperVirtual) -> None:
        """Open a browser page that shows a robot, if the simulation has a `gui`."""
        if self.gui:
            from pepper_kin.naoqi.body_page import BodyPage

            page = self._pages[robot.robot_model] = BodyPage(robot.body, points=robot.shown_points)
            page.open()

    def remove(self, model: int) -> None:
        """Remove a robot; end its modules and close its page."""
        self.robot(model).end()
        page = self._pages.pop(model, None)
        if page is not None:
            page.close()
        del self.robots[model]

    def clear(self) -> None:
        """Remove all robots."""
        for model in tuple(self.robots):
            self.remove(model)

    def step(self) -> None:
        """Advance by 1/240 s; the twins are simulated in cycles of 20 ms, each when it is due."""
        for robot in tuple(self.robots.values()):
            robot.body.time.spend(TIME_STEP)

    def set_gravity(self, gravity: Sequence[float]) -> None:
        """Set the gravity that acts on all robots [m/s^2], three numbers."""
        self.gravity = list(gravity)
        for robot in self.robots.values():
            robot.body.set_gravity(self.gravity)

    def set_scene(self, scene: Scene | None) -> None:
        """Replace the scene around the robots; the bodies remain."""
        self._own_scene = scene
        self.show_bodies()

    def show_bodies(self) -> None:
        """Update the scene with the bodies' present poses."""
        scene = self._own_scene
        for number, one in self.bodies.items():
            for k, (shape, place) in enumerate(one.parts):
                pose = one.base @ place
                scene = (scene or Scene()).add(f"body {number}/{k}", shape, pose[:3, 3], rpy_of(pose[:3, :3]))
        self.scene = scene
        for robot in self.robots.values():
            robot.body.scene = scene


_SIMULATIONS: dict[int, Simulation] = {}
_LOCK = threading.Lock()


def launch(auto_step: bool, gui: bool, scene: Scene | None) -> Simulation:
    """Start a simulation; its number is the smallest free one."""
    with _LOCK:
        client = next(k for k in range(len(_SIMULATIONS) + 1) if k not in _SIMULATIONS)
        _SIMULATIONS[client] = Simulation(client, auto_step, gui, scene)
        return _SIMULATIONS[client]


def end(client: int) -> bool:
    """End a simulation; return whether it existed."""
    simulation = running(client)
    if simulation is None:
        return False
    simulation.clear()
    with _LOCK:
        del _SIMULATIONS[client]
    return True


def all_running() -> tuple[int, ...]:
    """Return the numbers of the running simulations."""
    return tuple(_SIMULATIONS)


def running(client: object) -> Simulation | None:
    """Return the simulation with a number, or None."""
    return _SIMULATIONS.get(client) if isinstance(client, int) else None


def simulation_of(client: object) -> Simulation:
    """Return the simulation with a number.

    Raises:
        SimulationError: for an unknown number.
    """
    simulation = running(client)
    if simulation is None:
        known = ", ".join(map(str, _SIMULATIONS)) or "(none)"
        raise SimulationError(
            f"physics client: no simulation {shortened(repr(client))} runs; running: {known}"
        )
    return simulation


def body_of(client: int, model: int) -> Body:
    """Return the simulated body of a robot.

    Raises:
        SimulationError: for an unknown simulation or robot.
    """
    return simulation_of(client).robot(model).body


def finite(value: Any, quantity: str, unit: str) -> float:
    """Return a finite number.

    Raises:
        SimulationError: for any other value, with the name of the quantity.
    """
    if isinstance(value, bool | str | bytes) or not hasattr(value, "__float__"):
        raise SimulationError(f"{quantity}: got {shortened(repr(value))}, expected a number [{unit}]")
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise SimulationError(
            f"{quantity}: got {shortened(repr(value))}, expected a number [{unit}]"
        ) from error
    if not math.isfinite(number):
        raise SimulationError(f"{quantity}: got {number}, expected a finite number [{unit}]")
    return number


def numbers(values: Any, quantity: str, count: int, unit: str) -> list[float]:
    """Return a list of finite numbers.

    Raises:
        SimulationError: for a wrong count or any other value, with the name of the quantity.
    """
    if isinstance(values, str | bytes) or not hasattr(values, "__len__") or len(values) != count:
        raise SimulationError(f"{quantity}: got {shortened(repr(values))}, expected {count} numbers [{unit}]")
    return [finite(value, quantity, unit) for value in values]


def pose_on_floor(translation: Any, quaternion: Any) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [rad] of a robot that stands on the floor.

    Args:
        translation: Position x, y, z [m].
        quaternion: Quaternion x, y, z, w, of any length above zero.

    Raises:
        SimulationError: for wrong counts or values.
        UnsimulatedError: for a robot above the floor or tilted.
    """
    x, y, z = numbers(translation, "translation", 3, "m")
    a, b, c, w = numbers(quaternion, "quaternion", 4, "1")
    if math.hypot(a, b, c, w) < 1e-9:
        raise SimulationError(f"quaternion: got {shortened(repr(quaternion))}, expected one of length 1")
    if abs(z) > 1e-6 or math.hypot(a, b) > 1e-6 * math.hypot(a, b, c, w):
        raise UnsimulatedError(
            "a robot above the floor, or tilted",
            f"the twin's base moves on the floor; got z = {z:g} m, quaternion ({a:g}, {b:g}, {c:g}, {w:g})",
        )
    return x, y, 2.0 * math.atan2(c, w)
