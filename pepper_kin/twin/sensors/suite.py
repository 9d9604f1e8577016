"""Suite of all sensors of the robot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import kept_read_only
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import MOST, as_joint_vector, as_real, check_seed, shown
from pepper_kin.twin.sensors.camera_sensors import ColorCamera, DepthCamera
from pepper_kin.twin.sensors.inertial import Accelerometer, Gyroscope, Orientation
from pepper_kin.twin.sensors.joint_sensors import JointEncoders, JointTorques
from pepper_kin.twin.sensors.odometry_sensor import WheelOdometry
from pepper_kin.twin.sensors.range_sensors import Beams, Laser, Sonar
from pepper_kin.twin.sensors.reading import Reading, SensedState, StillWorld, Surroundings
from pepper_kin.twin.sensors.recording import ReadingSeries
from pepper_kin.twin.sensors.robot_rays import RobotRays
from pepper_kin.twin.sensors.sampling import SampledTogether
from pepper_kin.twin.sensors.sensor import Sensor
from pepper_kin.twin.sensors.specification import SensorSpecification, sensor_specifications
from pepper_kin.twin.sensors.switches import Pads, Switch

CAMERAS = ("camera_top", "camera_bottom", "camera_depth")
"""Sensors that cost a picture each time they are read; a suite holds them only if they are named."""

_PLAIN: dict[str, type[Sensor]] = {
    "joint_encoders": JointEncoders,
    "joint_torques": JointTorques,
    "accelerometer": Accelerometer,
    "gyroscope": Gyroscope,
    "orientation": Orientation,
    "wheel_odometry": WheelOdometry,
}
_RANGES = {"sonar": Sonar, "laser": Laser}
_PICTURES = {"color_camera": ColorCamera, "depth_camera": DepthCamera}


class ShownState(Protocol):
    """What a twin shows of itself."""

    time: float
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    torque: NDArray[np.float64]


class SensorSuite:
    """Pepper's sensors, each at its own rate.

    Sample k of a sensor is due at k periods.  The readings depend on the seed and on the states at which they
    are taken, not on which other sensors the suite has.

    Args:
        pepper: The robot.
        seed: Seed of all noise and bias, an integer of at least 0.
        sensors: Names of `sensor_specifications()`; by default all but the cameras.
        noise: Whether readings are disturbed; without, they are the truth within the sensor's range.
        specifications: Specifications in place of Pepper's own, or of more sensors, by name.
        floor: Whether there is a floor at z = 0 besides what the scene holds.
        scene: The world that `observe` measures, where it does not move.
        world: The world that `observe` measures, where it moves; one of the two at most.

    Attributes:
        sensors: The sensors by name, read-only.

    Raises:
        UnknownNameError: for a sensor that there is not, or a frame that the robot lacks.
        InvalidValueError: for a seed that is no such integer, both a scene and a world, or a specification
            under another name than its own.
    """

    sensors: Mapping[str, Sensor]

    def __init__(
        self,
        pepper: PepperModel,
        *,
        seed: int = 0,
        sensors: Iterable[str] | None = None,
        noise: bool = True,
        specifications: Mapping[str, SensorSpecification] | None = None,
        floor: bool = True,
        scene: Scene | None = None,
        world: Surroundings | None = None,
    ) -> None:
        if scene is not None and world is not None:
            raise InvalidValueError("scene and world", "both", "one of the two at most")
        self._world = StillWorld(_EMPTY if scene is None else scene, ()) if world is None else world
        check_seed(seed)
        known = dict(sensor_specifications())
        for name, specification in (specifications or {}).items():
            if not isinstance(specification, SensorSpecification):
                raise InvalidValueError(
                    f"specification {name!r}", type(specification).__name__, "a SensorSpecification"
                )
            if name != specification.name:
                raise InvalidValueError("name of a specification", repr(specification.name), repr(name))
            known[name] = specification
        chosen = [name for name in known if name not in CAMERAS] if sensors is None else sensors
        names = list(dict.fromkeys([chosen] if isinstance(chosen, str) else chosen))
        for name in names:
            if name not in known:
                raise UnknownNameError("sensor", name, known)
        self.pepper, self.noise = pepper, bool(noise)
        self._floor = floor
        self._pads: dict[float, Pads] = {}
        self._rays: dict[tuple[str, int], RobotRays] = {}
        self._beams: dict[tuple[RobotRays, float], Beams] = {}
        made = {name: self._made(known[name], int(seed)) for name in names}
        self.sensors = MappingProxyType(made)
        rates = dict.fromkeys(sensor.specification.rate for sensor in made.values())
        self._groups = [
            SampledTogether(
                rate, {name: s for name, s in made.items() if s.specification.rate == rate}, noise=noise
            )
            for rate in rates
        ]
        self._time, self._next = -math.inf, -math.inf
        self._waiting: list[tuple[SensedState, list[tuple[SampledTogether, int]]]] = []

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return tuple(self.sensors)

    @property
    def due(self) -> float:
        """Time before which nothing is read [s]: states up to there need not be shown to `observe`."""
        return self._next

    def reset(self) -> None:
        """Start again: every sensor is due at the next reading, and what was recorded is forgotten."""
        self._time, self._next, self._waiting = -math.inf, -math.inf, []
        for group in self._groups:
            group.reset()

    def read(
        self,
        time: float,
        q: ArrayLike,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        scene: Scene | None = None,
        contacts: Sequence[Any] | None = None,
    ) -> dict[str, Reading]:
        """Return the readings of the sensors whose period has elapsed.

        Args:
            time: Of the state [s]; not before that of the last reading.
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,); rest if omitted.
            a: Joint accelerations [rad/s^2 or m/s^2], shape (n,); none if omitted.
            torque: Of the servos [N m or N], shape (n,); none if omitted.
            scene: The world around the robot.
            contacts: Where the robot is touched: what `pepper_kin.collision.contacts` lists, or what a twin's
                world says (`names`, `point` and `force`, of which a force of 0 presses nothing).

        Returns:
            Readings by name; empty between samples.  Of several samples missed only the last is returned.

        Raises:
            InvalidValueError: for a time that goes back, wrong lengths, NaN or infinity.
        """
        if self._time <= time < self._next:
            self._time = time
            return {}
        self._decide()
        world = StillWorld(_EMPTY if scene is None else scene, () if contacts is None else contacts)
        state, due = self._sensed(time, {"q": q, "v": v, "a": a, "torque": torque}, world)
        readings = [group.readings(group.take(state, sample)) for group, sample in due]
        found = {name: reading for pairs in readings for name, reading in pairs}
        return {name: found[name] for name in self.sensors if name in found}

    def observe(self, state: ShownState) -> None:
        """Read what is due in a twin's state, and record it; a state not later than the last starts again.

        A twin calls it for its sensors: `Twin(pepper, sensors=suite)`.  The state,
        and what is around the robot now, are kept until somebody asks what was recorded.

        Args:
            state: Time, position, velocity, acceleration and torque.
        """
        if self._time < state.time < self._next:
            self._time = state.time
            return
        if state.time <= self._time:
            self.reset()
        vectors = {"q": state.position, "v": state.velocity, "a": state.acceleration, "torque": state.torque}
        self._waiting.append(self._sensed(state.time, vectors, self._world))

    def recorded(self, start: float = 0.0) -> dict[str, ReadingSeries]:
        """Return what `observe` has recorded since a time, by name; sensors without a sample are left out.

        Args:
            start: The first time that counts [s]; times count from there on.
        """
        self._decide()
        found = {name: series for group in self._groups for name, series in group.series(start)}
        return {name: found[name] for name in self.sensors if name in found}

    def _decide(self) -> None:
        """Take the samples of all states that wait, in their order."""
        waiting, self._waiting = self._waiting, []
        for state, due in waiting:
            for group, sample in due:
                group.record(group.take(state, sample))

    def _sensed(
        self, time: float, vectors: Mapping[str, ArrayLike | None], world: Surroundings
    ) -> tuple[SensedState, list[tuple[SampledTogether, int]]]:
        """Return a state as it is now, and which sensors are due, each with the number of its sample.

        Args:
            time: [s].
            vectors: "q" [rad or m], "v", "a" and "torque" [N m or N], shape (n,) each; None for zero.
            world: What is around the robot.
        """
        least = max(self._time, -MOST)
        if not least <= as_real(time) <= MOST:
            raise InvalidValueError("time", shown(time), f"at least {least:.9g} s, at most {MOST:g} s")
        checked = [self._vector(name, value) for name, value in vectors.items()]
        due = [(group, group.count_due(time)) for group in self._groups]
        due = [(group, sample) for group, sample in due if sample >= 0]
        frames = {frame: None for group, _ in due for frame in group.frames}
        if any(group.uses_scene for group, _ in due):
            world = StillWorld(world.snapshot(), world.contacts)
        self._time, self._next = time, min((group.due for group in self._groups), default=math.inf)
        return SensedState(self.pepper, float(time), checked, world, tuple(frames)), due

    def _vector(self, quantity: str, value: ArrayLike | None) -> NDArray[np.float64]:
        """Return a finite joint vector, shape (n,), by the name of its quantity; zero for None."""
        if value is None:
            return np.zeros(self.pepper.n)
        return kept_read_only(as_joint_vector(self.pepper, value, quantity))

    def _made(self, specification: SensorSpecification, seed: int) -> Sensor:
        if specification.kind == "switch":
            pads = self._pads.setdefault(specification.rate, Pads(self.pepper))
            return Switch(self.pepper, specification, seed, pads)
        if specification.kind in _RANGES or specification.kind in _PICTURES:
            geometry_type = "visual" if specification.name in CAMERAS else "collision"
            frame = self.pepper.frame_id(specification.frame)
            joint = int(self.pepper.inner_model.frames[frame].parentJoint)
            if (geometry_type, joint) not in self._rays:
                self._rays[geometry_type, joint] = RobotRays(
                    self.pepper, geometry_type, blind_to=specification.frame, floor=self._floor
                )
            rays = self._rays[geometry_type, joint]
            if specification.kind in _PICTURES:
                return _PICTURES[specification.kind](self.pepper, specification, seed, rays)
            beams = self._beams.setdefault((rays, specification.rate), Beams(rays))
            return _RANGES[specification.kind](self.pepper, specification, seed, beams)
        if specification.kind not in _PLAIN:
            raise UnknownNameError(
                "kind of sensor", specification.kind, [*_PLAIN, *_RANGES, *_PICTURES, "switch"]
            )
        return _PLAIN[specification.kind](self.pepper, specification, seed)


_EMPTY = Scene()
"""One object, so that what was made for it is found again."""
