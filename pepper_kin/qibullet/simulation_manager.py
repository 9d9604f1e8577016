"""Simulations: launched, reset, stopped, and robots in them."""

from __future__ import annotations

from collections.abc import Sequence

from pepper_kin.collision import Scene
from pepper_kin.qibullet import simulation
from pepper_kin.qibullet.other_robots import NaoVirtual, RomeoVirtual
from pepper_kin.qibullet.pepper_virtual import PepperVirtual
from pepper_kin.qibullet.simulation import numbers, running, simulation_of

ORIGIN = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class SimulationManager:
    """Launches simulations, and puts robots into them."""

    def launchSimulation(
        self,
        gui: bool = True,
        use_shared_memory: bool = False,
        auto_step: bool = True,
        *,
        scene: Scene | None = None,
    ) -> int:
        """Begin a simulation; return its number.

        Args:
            gui: Whether a page in the browser shows each robot.
            use_shared_memory: Without meaning here.
            auto_step: Whether the wall clock drives the simulation; otherwise time passes by
                `stepSimulation`, and while a call waits.
            scene: What stands around the robots, in place of bodies loaded by pybullet.
        """
        return simulation.launch(bool(auto_step), bool(gui), scene).client

    def resetSimulation(self, physics_client: int) -> None:
        """Remove the robots and the scene; the simulation goes on.

        Raises:
            SimulationError: where there is no such simulation.
        """
        found = simulation_of(physics_client)
        found.clear()
        found.bodies.clear()
        found.set_scene(None)

    def stopSimulation(self, physics_client: int) -> None:
        """End a simulation; without effect where there is none with this number."""
        simulation.end(physics_client)

    def stepSimulation(self, physics_client: int) -> None:
        """Let 1/240 s pass; without effect where the wall clock drives the simulation.

        Raises:
            SimulationError: where there is no such simulation.
        """
        simulation_of(physics_client).step()

    def getGravity(self, physics_client: int) -> list[float] | None:
        """Return the gravity [m/s^2], three numbers; None where there is no such simulation."""
        found = running(physics_client)
        return None if found is None else list(found.gravity)

    def setGravity(self, physics_client: int, gravity: Sequence[float]) -> None:
        """Let another gravity act on the links [m/s^2], three numbers; the base stays on the floor.

        Raises:
            SimulationError: for no such simulation, or values that are not three finite numbers.
        """
        simulation_of(physics_client).set_gravity(numbers(gravity, "gravity", 3, "m/s^2"))

    def setLightPosition(self, physics_client: int, light_position: Sequence[float]) -> None:
        """Keep where the light is [m], three numbers; the page in the browser has lights of its kind.

        Raises:
            SimulationError: for no such simulation, or values that are not three finite numbers.
        """
        found = simulation_of(physics_client)
        found.light = numbers(light_position, "light_position", 3, "m")

    def setScene(self, physics_client: int, scene: Scene | None) -> None:
        """Put something else around the robots: what cameras and lasers meet, and where the base stops.

        Raises:
            SimulationError: where there is no such simulation.
        """
        simulation_of(physics_client).set_scene(scene)

    def spawnPepper(
        self,
        physics_client: int,
        translation: Sequence[float] = ORIGIN,
        quaternion: Sequence[float] = UPRIGHT,
        spawn_ground_plane: bool = False,
    ) -> PepperVirtual:
        """Put a Pepper into a simulation.

        Args:
            physics_client: Number of the simulation.
            translation: x, y, z of the base [m]; z is 0.
            quaternion: x, y, z, w of the base, about the vertical axis.
            spawn_ground_plane: Without meaning: there is always a floor.

        Raises:
            SimulationError: for an unknown simulation, or values that are not finite numbers.
            UnsimulatedError: for a robot that would not stand on the floor.
        """
        pepper = PepperVirtual()
        pepper.loadRobot(translation, quaternion, physicsClientId=physics_client)
        return pepper

    def removePepper(self, pepper_virtual: PepperVirtual) -> None:
        """Take a Pepper out of its simulation.

        Raises:
            SimulationError: for a robot that is in none.
        """
        model = pepper_virtual.getRobotModel()
        simulation_of(pepper_virtual.getPhysicsClientId()).remove(-1 if model is None else model)

    def spawnNao(
        self,
        physics_client: int,
        translation: Sequence[float] = ORIGIN,
        quaternion: Sequence[float] = UPRIGHT,
        spawn_ground_plane: bool = False,
    ) -> NaoVirtual:
        """Refuse: there is no model of NAO.

        Raises:
            UnsimulatedError: always.
        """
        return NaoVirtual()

    def spawnRomeo(
        self,
        physics_client: int,
        translation: Sequence[float] = ORIGIN,
        quaternion: Sequence[float] = UPRIGHT,
        spawn_ground_plane: bool = False,
    ) -> RomeoVirtual:
        """Refuse: there is no model of Romeo.

        Raises:
            UnsimulatedError: always.
        """
        return RomeoVirtual()
