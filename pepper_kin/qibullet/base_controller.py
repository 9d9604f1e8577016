"""The controller of the base: motions to poses, and velocities."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

from pepper_kin.exceptions import shortened
from pepper_kin.naoqi.base_tasks import MoveToTask, VelocityTask
from pepper_kin.naoqi.joint_names import BASE_RESOURCES
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.qibullet.errors import SimulationError
from pepper_kin.qibullet.robot_module import RobotModule
from pepper_kin.qibullet.simulation import finite
from pepper_kin.twin.base import OmniBase, pepper_base


class PepperBaseController(RobotModule):
    """Controller of Pepper's base, within limits of velocity and acceleration.

    Args:
        robot_model: Number of the robot's model.
        speed: Linear [m/s] and angular velocity [rad/s] of `moveTo`.
        acceleration: Linear [m/s^2] and angular acceleration [rad/s^2].
        physicsClientId: Number of the simulation.

    Attributes:
        linear_velocity: Linear velocity of `moveTo` [m/s].
        angular_velocity: Angular velocity of `moveTo` [rad/s].
        linear_acceleration: Linear acceleration [m/s^2].
        angular_acceleration: Angular acceleration [rad/s^2].
    """

    FRAME_WORLD: ClassVar = 1
    FRAME_ROBOT: ClassVar = 2
    MAX_LINEAR_VELOCITY: ClassVar = 0.55
    MIN_LINEAR_VELOCITY: ClassVar = 0.1
    MAX_ANGULAR_VELOCITY: ClassVar = 2.0
    MIN_ANGULAR_VELOCITY: ClassVar = 0.3
    MAX_LINEAR_ACCELERATION: ClassVar = 0.55
    MIN_LINEAR_ACCELERATION: ClassVar = 0.1
    MAX_ANGULAR_ACCELERATION: ClassVar = 3.0
    MIN_ANGULAR_ACCELERATION: ClassVar = 0.1

    def __init__(
        self,
        robot_model: int,
        speed: tuple[float, float],
        acceleration: tuple[float, float],
        physicsClientId: int = 0,
    ) -> None:
        super().__init__(robot_model, physicsClientId)
        self.setLinearVelocity(speed[0])
        self._setAngularVelocity(speed[1])
        self._setLinearAcceleration(acceleration[0])
        self._setAngularAcceleration(acceleration[1])
        self._way: MoveToTask | None = None

    def setLinearVelocity(self, linear_velocity: float) -> None:
        """Set the linear velocity of `moveTo` [m/s], clipped to 0.1 to 0.55."""
        self.linear_velocity = _within(
            linear_velocity, "linear velocity", self.MIN_LINEAR_VELOCITY, self.MAX_LINEAR_VELOCITY
        )

    def moveTo(self, x: float, y: float, theta: float, frame: int, _async: bool = False) -> None:
        """Move to a pose.

        Args:
            x: Position along x [m].
            y: Position along y [m].
            theta: Yaw [rad].
            frame: FRAME_WORLD or FRAME_ROBOT.
            _async: Whether to return at once; a later asynchronous call changes the goal.

        Raises:
            SimulationError: for an unknown frame, values that are not finite numbers, or a synchronous call
                while an asynchronous one runs.
        """
        place = [finite(x, "x", "m"), finite(y, "y", "m"), finite(theta, "theta", "rad")]
        if frame not in (self.FRAME_WORLD, self.FRAME_ROBOT):
            raise SimulationError(f"frame: got {shortened(repr(frame))}, expected 1 (world) or 2 (robot)")
        if self.isAlive() and not _async:
            raise SimulationError(
                "moveTo: an asynchronous moveTo runs; stopMove ends it, _async=True changes its goal"
            )
        body = self.body
        task = MoveToTask("moveTo", [place], world=frame == self.FRAME_WORLD)
        with body.time.lock:
            self._stop()
            self._limit(self.linear_velocity, self.angular_velocity)
            body.do(task)
            self._way = task
        if not _async:
            body.wait(task)

    def move(self, x: float, y: float, theta: float) -> None:
        """Move with a velocity [m/s, m/s, rad/s], clipped to 0.55 m/s and 2 rad/s, until `stopMove`.

        Raises:
            SimulationError: for values that are not finite numbers.
        """
        line, turn = self.MAX_LINEAR_VELOCITY, self.MAX_ANGULAR_VELOCITY
        twist = [
            _within(x, "x", -line, line),
            _within(y, "y", -line, line),
            _within(theta, "theta", -turn, turn),
        ]
        body = self.body
        with body.time.lock:
            self._stop()
            self._limit(line, turn)
            body.do(VelocityTask("move", twist))

    def stopMove(self) -> None:
        """Brake; return at once."""
        with self.body.time.lock:
            self._stop()

    def isAlive(self) -> bool:
        """Return whether an asynchronous `moveTo` runs."""
        return self._way is not None and not self._way.ended

    def _stop(self) -> None:
        body = self.body
        tasks: list[BodyTask] = body.tasks.using(BASE_RESOURCES)
        body.tasks.kill(tasks, body)

    def _limit(self, linear: float, angular: float) -> None:
        """Set the limits of velocity [m/s, rad/s] and acceleration of the base."""
        geometry = replace(
            pepper_base(),
            linear_velocity=linear,
            angular_velocity=angular,
            linear_acceleration=self.linear_acceleration,
            angular_acceleration=self.angular_acceleration,
        )
        self.body.controller.base = OmniBase(geometry)

    def _terminateModule(self) -> None:
        """Stop the base."""
        self.stopMove()

    # The names below are private in qiBullet, but scripts use them.

    def _setAngularVelocity(self, angular_velocity: float) -> None:
        """Set the angular velocity of `moveTo` [rad/s], clipped to 0.3 to 2."""
        self.angular_velocity = _within(
            angular_velocity, "angular velocity", self.MIN_ANGULAR_VELOCITY, self.MAX_ANGULAR_VELOCITY
        )

    def _setLinearAcceleration(self, linear_acceleration: float) -> None:
        """Set the linear acceleration [m/s^2], clipped to 0.1 to 0.55."""
        self.linear_acceleration = _within(
            linear_acceleration,
            "linear acceleration",
            self.MIN_LINEAR_ACCELERATION,
            self.MAX_LINEAR_ACCELERATION,
        )

    def _setAngularAcceleration(self, angular_acceleration: float) -> None:
        """Set the angular acceleration [rad/s^2], clipped to 0.1 to 3."""
        self.angular_acceleration = _within(
            angular_acceleration,
            "angular acceleration",
            self.MIN_ANGULAR_ACCELERATION,
            self.MAX_ANGULAR_ACCELERATION,
        )


def _within(value: Any, quantity: str, least: float, most: float) -> float:
    """Return a finite number clipped to a range."""
    return min(max(finite(value, quantity, "m or rad, and s"), least), most)
