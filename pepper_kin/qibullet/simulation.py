"""Simulations by number: what runs in each, as clients of qiBullet count them."""

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
"""Time of a step of Bullet, and so of `stepSimulation` [s]."""

EARTH = (0.0, 0.0, -9.81)
"""Gravity when a simulation is launched [m/s^2]."""


class Simulation:
    """One simulation: its robots, what stands around them, and its gravity.

    Args:
        client: Its number.
        auto_step: Whether the wall clock drives it; otherwise `step` does.
        gui: Whether each robot is shown by a page in the browser.
        scene: What stands around the robots.

    Attributes:
        gravity: [m/s^2], three numbers.
        light: Where the light was put [m], three numbers, or None.
        robots: By the number of their model.
        bodies: What `pybullet` has put around them, by number.
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
        """Take a robot in; return the number of its model."""
        number = self.new_number()
        self.robots[number] = robot
        return number

    def new_number(self) -> int:
        """Return the number of the next robot or body."""
        self._next += 1
        return self._next

    def body(self, number: int) -> Standing:
        """Return the body with a number.

        Raises:
            SimulationError: where there is none.
        """
        if number not in self.bodies:
            known = ", ".join(map(str, self.bodies)) or "(none)"
            got = shortened(repr(number))
            raise SimulationError(f"no body {got} in simulation {self.client}; there are: {known}")
        return self.bodies[number]

    def robot(self, model: int) -> PepperVirtual:
        """Return the robot with a number.

        Raises:
            SimulationError: where there is none.
        """
        if model not in self.robots:
            known = ", ".join(map(str, self.robots)) or "(none)"
            raise SimulationError(
                f"no robot {shortened(repr(model))} in simulation {self.client}; there are: {known}"
            )
        return self.robots[model]

    def show(self, robot: PepperVirtual) -> None:
        """Open a page in the browser that follows a robot, where the simulation has a `gui`."""
        if self.gui:
            from pepper_kin.naoqi.body_page import BodyPage

            page = self._pages[robot.robot_model] = BodyPage(robot.body, points=robot.shown_points)
            page.open()

    def remove(self, model: int) -> None:
        """End the modules of a robot and its page, and forget it."""
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
        """Let 1/240 s pass; the twins are computed in cycles of 20 ms, each when it is due."""
        for robot in tuple(self.robots.values()):
            robot.body.time.spend(TIME_STEP)

    def set_gravity(self, gravity: Sequence[float]) -> None:
        """Let another gravity act on all robots [m/s^2], three numbers."""
        self.gravity = list(gravity)
        for robot in self.robots.values():
            robot.body.set_gravity(self.gravity)

    def set_scene(self, scene: Scene | None) -> None:
        """Put something else around the robots, beside the bodies."""
        self._own_scene = scene
        self.show_bodies()

    def show_bodies(self) -> None:
        """Put the bodies where they are now."""
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
    """Begin a simulation; its number is the smallest that is free."""
    with _LOCK:
        client = next(k for k in range(len(_SIMULATIONS) + 1) if k not in _SIMULATIONS)
        _SIMULATIONS[client] = Simulation(client, auto_step, gui, scene)
        return _SIMULATIONS[client]


def end(client: int) -> bool:
    """End a simulation; return whether there was one with this number."""
    simulation = running(client)
    if simulation is None:
        return False
    simulation.clear()
    with _LOCK:
        del _SIMULATIONS[client]
    return True


def all_running() -> tuple[int, ...]:
    """Return the numbers of the simulations that run."""
    return tuple(_SIMULATIONS)


def running(client: object) -> Simulation | None:
    """Return the simulation with a number, or None."""
    return _SIMULATIONS.get(client) if isinstance(client, int) else None


def simulation_of(client: object) -> Simulation:
    """Return the simulation with a number.

    Raises:
        SimulationError: where there is none.
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
        SimulationError: where there is no such simulation or robot.
    """
    return simulation_of(client).robot(model).body


def finite(value: Any, quantity: str, unit: str) -> float:
    """Return a finite number.

    Raises:
        SimulationError: for anything else, naming the quantity.
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
        SimulationError: for another number of them, or anything else, naming the quantity.
    """
    if isinstance(values, str | bytes) or not hasattr(values, "__len__") or len(values) != count:
        raise SimulationError(f"{quantity}: got {shortened(repr(values))}, expected {count} numbers [{unit}]")
    return [finite(value, quantity, unit) for value in values]


def pose_on_floor(translation: Any, quaternion: Any) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [rad] of a robot that stands on the floor.

    Args:
        translation: x, y, z [m].
        quaternion: x, y, z, w; of any length above zero.

    Raises:
        SimulationError: for other numbers of values.
        UnsimulatedError: for a robot that would not stand on the floor.
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
