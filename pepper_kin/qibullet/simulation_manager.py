"""The manager of simulations and of robots in them."""

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
    """Launches simulations, and spawns robots in them."""

    def launchSimulation(
        self,
        gui: bool = True,
        use_shared_memory: bool = False,
        auto_step: bool = True,
        *,
        scene: Scene | None = None,
    ) -> int:
        """Start a simulation; return its number.

        Args:
            gui: Whether a browser page shows each robot.
            use_shared_memory: Ignored.
            auto_step: Whether the wall clock drives the simulation; otherwise time passes in
                `stepSimulation` and in calls that wait.
            scene: Obstacles around the robots; bodies of pybullet are added to them.
        """
        return simulation.launch(bool(auto_step), bool(gui), scene).client

    def resetSimulation(self, physics_client: int) -> None:
        """Remove robots, bodies and scene; the simulation goes on.

        Raises:
            SimulationError: for an unknown simulation.
        """
        found = simulation_of(physics_client)
        found.clear()
        found.bodies.clear()
        found.set_scene(None)

    def stopSimulation(self, physics_client: int) -> None:
        """End a simulation; without effect for an unknown one."""
        simulation.end(physics_client)

    def stepSimulation(self, physics_client: int) -> None:
        """Advance by 1/240 s; without effect if the wall clock drives the simulation.

        Raises:
            SimulationError: for an unknown simulation.
        """
        simulation_of(physics_client).step()

    def getGravity(self, physics_client: int) -> list[float] | None:
        """Return the gravity [m/s^2], three numbers; None for an unknown simulation."""
        found = running(physics_client)
        return None if found is None else list(found.gravity)

    def setGravity(self, physics_client: int, gravity: Sequence[float]) -> None:
        """Set the gravity that acts on the links [m/s^2], three numbers; the base stays on the floor.

        Raises:
            SimulationError: for an unknown simulation, or values that are not three finite numbers.
        """
        simulation_of(physics_client).set_gravity(numbers(gravity, "gravity", 3, "m/s^2"))

    def setLightPosition(self, physics_client: int, light_position: Sequence[float]) -> None:
        """Store the position of the light [m], three numbers; the browser page has its own lights.

        Raises:
            SimulationError: for an unknown simulation, or values that are not three finite numbers.
        """
        found = simulation_of(physics_client)
        found.light = numbers(light_position, "light_position", 3, "m")

    def setScene(self, physics_client: int, scene: Scene | None) -> None:
        """Replace the scene around the robots, which cameras and lasers detect and the base avoids.

        Raises:
            SimulationError: for an unknown simulation.
        """
        simulation_of(physics_client).set_scene(scene)

    def spawnPepper(
        self,
        physics_client: int,
        translation: Sequence[float] = ORIGIN,
        quaternion: Sequence[float] = UPRIGHT,
        spawn_ground_plane: bool = False,
    ) -> PepperVirtual:
        """Spawn a Pepper in a simulation.

        Args:
            physics_client: Number of the simulation.
            translation: Position x, y, z of the base [m]; z must be 0.
            quaternion: Quaternion x, y, z, w of the base, about the vertical axis.
            spawn_ground_plane: Ignored: there is always a floor.

        Raises:
            SimulationError: for an unknown simulation, or values that are not finite numbers.
            UnsimulatedError: for a robot above the floor or tilted.
        """
        pepper = PepperVirtual()
        pepper.loadRobot(translation, quaternion, physicsClientId=physics_client)
        return pepper

    def removePepper(self, pepper_virtual: PepperVirtual) -> None:
        """Remove a Pepper from its simulation.

        Raises:
            SimulationError: for a robot that is in no simulation.
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
        """Raise UnsimulatedError: NAO is not simulated.

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
        """Raise UnsimulatedError: Romeo is not simulated.

        Raises:
            UnsimulatedError: always.
        """
        return RomeoVirtual()
