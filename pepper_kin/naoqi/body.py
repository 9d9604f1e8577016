"""The simulated body behind the modules: the twin, its commands and its stiffness, cycle by cycle."""

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
"""References to the twin in a cycle."""

WEAKEST = 1e-3
"""Share of an actuator's strength that stands for stiffness 0: the twin wants it above 0."""

_RESTING = 1e-5  # [rad]; an arm that moves less in a cycle is at rest

LOOK_EVERY = 10
"""Cycles between two looks for obstacles in the way of the base."""

MODES = ("robot", "twin")


class Body:
    """Pepper as ALMotion sees it: commanded angles, stiffness, base, and the twin that follows.

    Args:
        mode: "robot" refuses what Pepper refuses, and protects its arms; "twin" does it, and lets arms go
            where they are sent.
        real_time: Whether the wall clock drives the simulation; see `SimulatedTime`.
        scene: What stands around the robot, for its sensors and its checks of collision; the mass of what is
            attached to the robot counts.
        posture: Where it begins.
        response: How the joints follow: "ideal", or as "measured" on a robot, see `joint_response`, with
            servos as stiff as that robot's.

    Attributes:
        pepper: The model: planar base, hands of one joint each.
        command: Commanded positions in the model's order [rad, m or share], shape (n,).
        reference: Those of them that the protection of the arms allows, shape (n,).
        controller: Of the base.
        time: The clock.
        tasks: What moves the joints.
        response: How the joints follow their commands.
        awake: Whether the motors are on.
        stiffness: By joint, 0 to 1.
        wheel_angles: Turns of the wheels [rad], shape (3,).
        move_protected: Whether the base keeps its distance from the scene.
        protection: Of the arms, against collisions.
        head_range: Where the pitch of the head stops.
        security_distance: "tangential" and "orthogonal" distance that the base keeps from obstacles [m].
        listeners: Called after each cycle, with the lock held.
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
        """State of the twin; its clock starts again at 0 whenever the stiffness changes."""
        return self._twin.state

    @property
    def velocity_limits(self) -> dict[str, float]:
        """The fastest that each joint may move [rad/s or shares/s]."""
        return {name: float(self.pepper.velocity_limits[k]) for name, k in self.index.items()}

    def commanded(self, name: str) -> float:
        """Return the commanded angle of a joint that is allowed; of a wheel its turn [rad]."""
        if name in WHEELS:
            return float(self.wheel_angles[WHEELS.index(name)])
        return float(self.reference[self.index[name]])

    def last_command(self, name: str) -> float:
        """Return the angle commanded in the last cycle, within the limits of speed [rad or share]."""
        return float(self._last[self.index[name]])

    def command_rate(self, name: str) -> float:
        """Return how fast the command of a joint moves [rad/s or shares/s]."""
        return float(self._rate[self.index[name]])

    def measured(self, name: str) -> float:
        """Return the angle that the encoder of a joint reads; of a wheel its turn [rad]."""
        if name in WHEELS:
            return float(self.wheel_angles[WHEELS.index(name)])
        return float(self.state.position[self.index[name]])

    def is_limp(self, name: str) -> bool:
        """Return whether the motor of a joint is off, so that no command moves it."""
        return self.stiffness[name] < WEAKEST

    def is_held(self, name: str) -> bool:
        """Return whether a joint was kept from where it was sent: the pitch of the head."""
        return self.head_range.stopped and self.index[name] == self.head_range.pitch

    def slides(self, name: str) -> bool:
        """Return whether a joint of a protected arm, kept from where it was sent, still moves."""
        return bool(self._slides[self.index[name]])

    def clipped(self, name: str, value: float) -> float:
        """Return an angle within the limits of a joint [rad or share]."""
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
        """Set how strong the motors of joints are, 0 to 1."""
        self.stiffness.update(values)
        self._strength_due = True

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Let another gravity act on the links [m/s^2], shape (3,); the base stays on the floor."""
        with self.time.lock:
            model = self.pepper.pinocchio_model
            model.gravity.linear = np.asarray(gravity, dtype=float)
            self.pepper = self.pepper.with_pinocchio_model(model)
            self._set_strength()

    def do(self, task: BodyTask) -> BodyTask:
        """Hand a task to the simulation."""
        with self.time.lock:
            return self.tasks.add(task)

    def wait(self, task: BodyTask) -> None:
        """Let time pass until a task is over; raise what ended it before its time."""
        self.time.wait_until(lambda: task.ended)
        if task.failure is not None:
            raise task.failure

    def blocked(self, twist: ArrayLike) -> bool:
        """Return whether something of the scene is too near in the direction of a velocity of the base.

        That is where the robot, moved that way by the orthogonal security distance, would touch it, or
        where it comes nearer to something than the tangential security distance.  Looked at five
        times a second.

        Args:
            twist: v_x, v_y [m/s], omega [rad/s] in the axes of the base, shape (3,).
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
            within: Largest distance that is looked for [m].
        """
        assert self.scene is not None
        if within <= 0.0:
            return float("inf")
        objects = set(self.scene.objects)
        near = collision.near_pairs(self.pepper, q, within, self.scene)
        pairs = zip(near.names, near.distances, strict=True)
        return min((float(d) for names, d in pairs if objects & set(names)), default=float("inf"))

    def nearest_obstacle(self, within: float = 3.0) -> Array | None:
        """Return the point of the scene nearest to the robot in the world, or None beyond a distance [m]."""
        if self.scene is None:
            return None
        near = collision.near_pairs(self.pepper, self.configuration(True), within, self.scene)
        for names, points in zip(near.names, near.points, strict=True):  # nearest first
            for name, point in zip(names, points, strict=True):
                if name in self.scene.objects:
                    return np.array(point)
        return None

    def place_base(self, pose: Array) -> None:
        """Put the base somewhere at once: x, y [m], yaw [rad], shape (3,)."""
        self.controller.reset(pose)
        for positions in (self.command, self._last, self.reference):
            positions[self._base] = pose
        self._followers.put(self._base, pose)
        position = np.array(self.state.position)
        position[self._base] = pose
        self._twin.reset(position)

    def _cycle(self) -> None:
        """Do one cycle of 20 ms."""
        free = self._unprotected()
        self._hold_idle()
        self.tasks.step(self)
        free |= self._unprotected()  # of tasks that have just begun; before, of those that have just ended
        self._limit_rates()
        before, most = self.reference, self.pepper.velocity_limits * CYCLE
        allowed = self.protection.allowed(before, self.command, self.scene, free)
        # an arm whose protection has just ended goes on no faster than it may
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
        """Let joints that no task moves stay where the protection of the arms has kept them."""
        kept = np.flatnonzero(self.command != self.reference)
        if kept.size:
            booked = {self.index[name] for name in self.tasks.booked if name in self.index}
            idle = [k for k in kept.tolist() if k not in booked]
            self.command[idle] = self._last[idle] = self.reference[idle]
            self._rate[idle] = 0.0

    def _unprotected(self) -> set[int]:
        """Return the joints that tasks move without protection."""
        moved = (name for task in self.tasks if not task.protected for name in task.resources)
        return {self.index[name] for name in moved if name in self.index}

    def _limit_rates(self) -> None:
        """Keep commanded angles within position and velocity limits, as ALMotion's last filter does.

        The range of the head counts whatever its speed: the yaw pushes the pitch.
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
        """Return a twin that carries what is attached; scenes of a body change, and it meets none of them."""
        return Twin(
            self.pepper,
            CYCLE / ROWS,
            feedforward="inverse_dynamics",
            actuators=parameters,
            scene=None if self.scene is None else Scene(attached=self.scene.attached),
        )

    def _set_strength(self) -> None:
        """Give the twin actuators of the present stiffness, in its present state."""
        strength = {name: max(self.stiffness[name], WEAKEST) for name in self.index}
        state = self._twin.state
        parameters = actuator_parameters(self.pepper, self._detail).changed(strength=strength)
        self._twin = self._twin_with(parameters)
        inside = np.clip(state.position, self.pepper.lower_limits, self.pepper.upper_limits)
        self._twin.reset(inside, state.velocity)
        self._strength_due = False
