"""The simulated body behind the modules: the twin with its commands and stiffness, cycle by cycle."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import collision, kinematics
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.naoqi.head_range import HeadRange
from pepper_kin.naoqi.joint_followers import JointFollowers
from pepper_kin.naoqi.joint_names import ACTUATED, BODY, WHEELS
from pepper_kin.naoqi.simulated_time import CYCLE, SimulatedTime
from pepper_kin.naoqi.tasks import BodyTask, Tasks
from pepper_kin.twin import (
    ActuatorParameters,
    RunStatus,
    Twin,
    TwinState,
    actuator_parameters,
    joint_response,
)
from pepper_kin.twin.arm_protection import arm_protection
from pepper_kin.twin.base import BaseController, OmniBase, pepper_base, world_velocity

ROWS = 4
"""Number of references that the twin gets in a cycle."""

WEAKEST = 1e-3
"""Fraction of an actuator's strength for stiffness 0: the twin needs a fraction above 0."""

_RESTING = 1e-5  # [rad]; an arm joint that moves less in a cycle is at rest

LOOK_EVERY = 10
"""Number of cycles between two checks for obstacles in the path of the base."""

MODES = ("robot", "twin")


class Body:
    """Simulated Pepper of ALMotion: commanded angles, stiffness, base, and the twin that follows.

    Args:
        mode: "robot" refuses the calls that Pepper refuses, and protects the arms from collisions; "twin"
            executes them, and does not protect the arms.
        real_time: Whether the wall clock drives the simulation; see `SimulatedTime`.
        scene: Obstacles around the robot, for its sensors and collision checks, and attached objects, whose
            mass counts.
        posture: Name of the posture at the start.
        response: How the joints follow their commands: "ideal", or as "measured" on a robot with servos of
            that robot's stiffness, see `joint_response`.

    Attributes:
        pepper: The model: planar base, hands of one joint each.
        command: Commanded positions in the model's order [rad, m or fraction], shape (n,).
        reference: Commanded positions after the protection of the arms, shape (n,).
        controller: Controller of the base.
        time: The clock.
        tasks: Tasks that move the joints and the base.
        response: How the joints follow their commands.
        awake: Whether the motors are on.
        stiffness: Stiffness by joint name, 0 to 1.
        wheel_angles: Angles of the wheels [rad], shape (3,).
        move_protected: Whether the base keeps its distance from the scene.
        protection: Protection of the arms against collisions.
        head_range: Range of the head's pitch.
        security_distance: "tangential" and "orthogonal" distance that the base keeps from obstacles [m].
        listeners: Functions that are called after each cycle, with the lock held.
    """

    def __init__(
        self,
        *,
        mode: str = "twin",
        real_time: bool = True,
        scene: Scene | None = None,
        posture: str = "Stand",
        response: str = "ideal",
    ) -> None:
        self.pepper: PepperModel = load_pepper(base="planar", hands="mimic")
        self.mode = mode
        self.scene = scene
        self.index: dict[str, int] = {name: self.pepper.joint_index(name) for name in ACTUATED}
        self._base = [self.pepper.joint_index(name) for name in ("BaseX", "BaseY", "BaseYaw")]
        self.command: Array = np.array(self.pepper.posture(posture), dtype=float)
        self.controller = BaseController(OmniBase(pepper_base()), float("inf"))
        self.awake = True
        self.stiffness: dict[str, float] = dict.fromkeys(BODY, 1.0)
        self.wheel_angles = np.zeros(3)
        self.tasks = Tasks()
        self.listeners: list[Callable[[], object]] = []
        self.time = SimulatedTime(self._cycle, real_time)
        self.move_protected = True
        self.protection = arm_protection(self.pepper, CYCLE)
        self.protection.active = mode == "robot"
        self.head_range = HeadRange(self.pepper)
        self.security_distance = {"tangential": 0.1, "orthogonal": 0.4}
        self._looked_at, self._is_blocked = -LOOK_EVERY, False
        self._last, self.reference = self.command.copy(), self.command.copy()
        self._rate = np.zeros(self.pepper.n)
        self._slides = np.zeros(self.pepper.n, dtype=bool)
        self._detail = "measured" if response == "measured" else "motor"
        parameters = actuator_parameters(self.pepper, self._detail)
        self.response = joint_response(self.pepper, response)
        self._followers = JointFollowers(self.pepper, self.response, self.command, parameters.latency)
        self._followed_rate = np.zeros(self.pepper.n)
        self._twin = self._twin_with(parameters)
        self._twin.reset(self.command)
        self._strength_due = False

    @property
    def state(self) -> TwinState:
        """State of the twin; its time restarts at 0 whenever the stiffness changes."""
        return self._twin.state

    @property
    def velocity_limits(self) -> dict[str, float]:
        """Maximum speed of each joint [rad/s or 1/s]."""
        return {name: float(self.pepper.velocity_limits[k]) for name, k in self.index.items()}

    def commanded(self, name: str) -> float:
        """Return the commanded position of a joint after the arms' protection, or a wheel's angle [rad]."""
        if name in WHEELS:
            return float(self.wheel_angles[WHEELS.index(name)])
        return float(self.reference[self.index[name]])

    def last_command(self, name: str) -> float:
        """Return the position commanded in the last cycle, within the velocity limits [rad or fraction]."""
        return float(self._last[self.index[name]])

    def command_rate(self, name: str) -> float:
        """Return the rate of a joint's command [rad/s or 1/s]."""
        return float(self._rate[self.index[name]])

    def measured(self, name: str) -> float:
        """Return a joint's encoder reading [rad or fraction], or a wheel's angle [rad]."""
        if name in WHEELS:
            return float(self.wheel_angles[WHEELS.index(name)])
        return float(self.state.position[self.index[name]])

    def is_limp(self, name: str) -> bool:
        """Return whether the motor of a joint is off, so that commands do not move it."""
        return self.stiffness[name] < WEAKEST

    def is_held(self, name: str) -> bool:
        """Return whether a joint is the head's pitch and was stopped at its range."""
        return self.head_range.stopped and self.index[name] == self.head_range.pitch

    def slides(self, name: str) -> bool:
        """Return whether a joint of a protected arm still moves, but not to its command."""
        return bool(self._slides[self.index[name]])

    def clipped(self, name: str, value: float) -> float:
        """Return an angle within the limits of a joint [rad or fraction]."""
        k = self.index[name]
        return float(np.clip(value, self.pepper.lower_limits[k], self.pepper.upper_limits[k]))

    def configuration(self, use_sensors: bool) -> Array:
        """Return the joint positions of the model, measured or commanded, shape (n,)."""
        if use_sensors:
            return np.array(self.state.position)
        q = self.reference.copy()
        q[self._base] = self.controller.pose
        return q

    def frame_pose(self, frame: str, use_sensors: bool) -> Array:
        """Return the pose of a frame of the model in the world, shape (4, 4)."""
        return np.asarray(kinematics.frame_pose(self.pepper, self.configuration(use_sensors), frame))

    def base_pose(self, use_sensors: bool) -> Array:
        """Return x, y [m] and yaw [rad] of the base in the world, shape (3,)."""
        if use_sensors:
            return np.array(self.state.position[self._base])
        return np.array(self.controller.pose)

    def set_stiffness(self, values: Mapping[str, float]) -> None:
        """Set the stiffness of joints, 0 to 1."""
        self.stiffness.update(values)
        self._strength_due = True

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Set the gravity that acts on the links [m/s^2], shape (3,); the base stays on the floor."""
        with self.time.lock:
            model = self.pepper.pinocchio_model
            model.gravity.linear = np.asarray(gravity, dtype=float)
            self.pepper = self.pepper.with_pinocchio_model(model)
            self._set_strength()

    def do(self, task: BodyTask) -> BodyTask:
        """Add a task to the simulation, and return it."""
        with self.time.lock:
            return self.tasks.add(task)

    def wait(self, task: BodyTask) -> None:
        """Wait until a task has ended; raise the error that ended it early."""
        self.time.wait_until(lambda: task.ended)
        if task.failure is not None:
            raise task.failure

    def blocked(self, twist: ArrayLike) -> bool:
        """Return whether the scene is too near for a velocity of the base.

        It is too near if the robot, moved by the orthogonal security distance in the direction of the
        velocity, would touch it, or if a small step in that direction reduces a distance that is below the
        tangential security distance.  Checked five times a second.

        Args:
            twist: Velocity v_x, v_y [m/s], omega [rad/s] in the axes of the base, shape (3,).
        """
        wanted = np.asarray(twist, dtype=float)
        speed = float(np.hypot(wanted[0], wanted[1]))
        if self.scene is None or not self.move_protected or speed < 1e-3:
            return False
        count = round(self.time.now / CYCLE)
        if count >= self._looked_at + LOOK_EVERY:
            self._looked_at = count
            q = self.configuration(False)
            yaw = float(q[self._base[2]])
            ahead = world_velocity([*(wanted[:2] / speed), 0.0], yaw)[:2]
            far, near = q.copy(), q.copy()
            braking = self.controller.braking_distance()
            far[self._base[:2]] += (self.security_distance["orthogonal"] + braking) * ahead
            near[self._base[:2]] += (0.01 + braking) * ahead
            beside = self.security_distance["tangential"]
            there = self._scene_distance(near, beside)
            closer = there < beside and there < self._scene_distance(q, beside + 0.1) - 1e-4
            self._is_blocked = closer or self._scene_distance(far, 1e-3) < 1e-3
        return self._is_blocked

    def _scene_distance(self, q: Array, within: float) -> float:
        """Return the distance of the robot from the nearest object of the scene [m], inf beyond `within`.

        Args:
            q: Joint positions [rad or m], shape (n,).
            within: Largest distance that is searched [m].
        """
        assert self.scene is not None
        if within <= 0.0:
            return float("inf")
        objects = set(self.scene.objects)
        near = collision.near_pairs(self.pepper, q, within, self.scene)
        pairs = zip(near.names, near.distances, strict=True)
        return min((float(d) for names, d in pairs if objects & set(names)), default=float("inf"))

    def nearest_obstacle(self, within: float = 3.0) -> Array | None:
        """Return the nearest point of the scene in the world frame [m], or None beyond a distance [m]."""
        if self.scene is None:
            return None
        near = collision.near_pairs(self.pepper, self.configuration(True), within, self.scene)
        for names, points in zip(near.names, near.points, strict=True):  # nearest first
            for name, point in zip(names, points, strict=True):
                if name in self.scene.objects:
                    return np.array(point)
        return None

    def place_base(self, pose: Array) -> None:
        """Teleport the base to x, y [m], yaw [rad], shape (3,)."""
        self.controller.reset(pose)
        for positions in (self.command, self._last, self.reference):
            positions[self._base] = pose
        self._followers.put(self._base, pose)
        position = np.array(self.state.position)
        position[self._base] = pose
        self._twin.reset(position)

    def _cycle(self) -> None:
        """Simulate one cycle of 20 ms."""
        free = self._unprotected()
        self._hold_idle()
        self.tasks.step(self)
        free |= self._unprotected()  # of tasks that have just started; above, of tasks that have just ended
        self._limit_rates()
        before, most = self.reference, self.pepper.velocity_limits * CYCLE
        allowed = self.protection.allowed(before, self.command, self.scene, free)
        # an arm whose protection has just ended keeps to its velocity limits
        self.reference = np.clip(allowed, before - most, before + most)
        self._slides = (self.reference != self.command) & (np.abs(self.reference - before) > _RESTING)
        limp = [k for name, k in self.index.items() if self.is_limp(name)]
        if limp:
            for positions in (self.command, self._last, self.reference):
                positions[limp] = self.state.position[limp]
            self._followers.put(limp, self.state.position[limp])
        if self._strength_due:
            self._set_strength()
        position, velocity, acceleration = self._references()
        run = self._twin.follow(position, velocity, acceleration=acceleration)
        if run.status is RunStatus.STOPPED:
            raise RuntimeError(f"the simulation of the body stopped: {run.message}")
        for listener in tuple(self.listeners):
            listener()

    def _hold_idle(self) -> None:
        """Set the command of joints without a task to the position that the arms' protection allows."""
        kept = np.flatnonzero(self.command != self.reference)
        if kept.size:
            booked = {self.index[name] for name in self.tasks.booked if name in self.index}
            idle = [k for k in kept.tolist() if k not in booked]
            self.command[idle] = self._last[idle] = self.reference[idle]
            self._rate[idle] = 0.0

    def _unprotected(self) -> set[int]:
        """Return the indices of the joints that tasks move without protection."""
        moved = (name for task in self.tasks if not task.protected for name in task.resources)
        return {self.index[name] for name in moved if name in self.index}

    def _limit_rates(self) -> None:
        """Keep commanded angles within position and velocity limits, as ALMotion's last filter does.

        The range of the head's pitch depends on the yaw and is kept at any speed.
        """
        pepper = self.pepper
        most = pepper.velocity_limits * CYCLE
        moved = np.clip(self.command, self._last - most, self._last + most)
        self.command = np.clip(moved, pepper.lower_limits, pepper.upper_limits)
        self.head_range.keep(self.command)

    def _references(self) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations for the twin in this cycle, shape (ROWS, n) each.

        The joints go from reference to reference along a line with a velocity that is continuous over two
        cycles; the base along the arcs of its controller.
        """
        h = CYCLE / ROWS
        before = self._followers.position
        way = self._followers.step(self.reference) - before
        rate = way / CYCLE
        share = (1.0 + np.arange(ROWS))[:, None] / ROWS
        position = before + share * way
        velocity = np.tile(rate, (ROWS, 1))
        acceleration = np.tile((rate - self._followed_rate) / CYCLE, (ROWS, 1))
        most = self.pepper.acceleration_limits
        acceleration = np.clip(acceleration, -most, most)
        twist_before = self.controller.twist
        if self.controller.stands:
            position[:, self._base] = self.controller.pose
            velocity[:, self._base] = acceleration[:, self._base] = 0.0
        for row in () if self.controller.stands else range(ROWS):
            twist = self.controller.step(h)
            pose = self.controller.pose
            position[row, self._base] = pose
            velocity[row, self._base] = world_velocity(twist, float(pose[2]))
            acceleration[row, self._base] = world_velocity((twist - twist_before) / h, float(pose[2]))
            self.wheel_angles += h * self.controller.base.wheel_speeds((twist + twist_before) / 2.0)
            twist_before = twist
        self._rate, self._followed_rate = (self.command - self._last) / CYCLE, rate
        self.command[self._base] = self.reference[self._base] = self.controller.pose
        self._followers.put(self._base, self.controller.pose)
        self._last = self.command.copy()
        return position, velocity, acceleration

    def _twin_with(self, parameters: ActuatorParameters) -> Twin:
        """Return a twin with the attached objects and no obstacles, as the scene may change meanwhile."""
        return Twin(
            self.pepper,
            CYCLE / ROWS,
            feedforward="inverse_dynamics",
            actuators=parameters,
            scene=None if self.scene is None else Scene(attached=self.scene.attached),
        )

    def _set_strength(self) -> None:
        """Replace the twin by one with actuators of the present stiffness, in the same state."""
        strength = {name: max(self.stiffness[name], WEAKEST) for name in self.index}
        state = self._twin.state
        parameters = actuator_parameters(self.pepper, self._detail).changed(strength=strength)
        self._twin = self._twin_with(parameters)
        inside = np.clip(state.position, self.pepper.lower_limits, self.pepper.upper_limits)
        self._twin.reset(inside, state.velocity)
        self._strength_due = False
