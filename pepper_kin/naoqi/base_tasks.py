"""Tasks that move the base: a velocity, or a path through poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.naoqi.joint_names import BASE_RESOURCES
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body


NEAR, TURNED = 0.004, 0.008
"""Distance [m] and angle [rad] from a pose below which the pose counts as reached."""


def as_turn(angle: float) -> float:
    """Wrap an angle to -pi to pi [rad]; half a turn keeps its sign, as pi in 32 bits is above pi."""
    return angle if abs(angle) < math.pi + TURNED else math.remainder(angle, 2.0 * math.pi)


class VelocityTask(BodyTask):
    """Move the base with a velocity until the task is stopped.

    Args:
        name: Name of the method that started the task.
        twist: Velocity v_x, v_y [m/s], omega [rad/s] in the axes of the base, shape (3,).
    """

    def __init__(self, name: str, twist: Sequence[float]) -> None:
        super().__init__(name, BASE_RESOURCES, reactive=True)
        self.twist = np.asarray(twist, dtype=float)

    def step(self, body: Body) -> bool:
        """Command the velocity; a command of zero ends when the base is at rest."""
        if body.blocked(self.twist):
            self.error = "an obstacle is nearer than the security distance"
            body.controller.command((0.0, 0.0, 0.0))
            return bool(np.abs(body.controller.twist).max() > 1e-6)
        body.controller.command(self.twist)
        return bool(np.abs(self.twist).max() > 0 or np.abs(body.controller.twist).max() > 1e-6)

    def finish(self, body: Body) -> None:
        """Command the velocity zero."""
        body.controller.command((0.0, 0.0, 0.0))


class MoveToTask(BodyTask):
    """Move the base through poses.

    Between two poses it turns by the difference of their yaws, to the left where the difference is positive.

    Args:
        name: Name of the method that started the task.
        places: Poses x, y [m], yaw [rad], shape (3,) each, in the frame of the base at the start.
        world: Whether the poses are in the world frame instead.
        duration: Time for the whole path [s]; as fast as the limits allow if None.
    """

    def __init__(
        self,
        name: str,
        places: Sequence[ArrayLike],
        *,
        world: bool = False,
        duration: float | None = None,
    ) -> None:
        super().__init__(name, BASE_RESOURCES)
        self._places = [np.asarray(place, dtype=float) for place in places]
        self._world, self._duration = world, duration
        self._goals: list[Array] = []
        self._share = 1.0
        self._stuck = 0

    def start(self, body: Body) -> None:
        """Transform the poses into the world frame."""
        here = np.array(body.base_pose(False))
        x, y, yaw = here.tolist()
        cos, sin = math.cos(yaw), math.sin(yaw)
        way = turned = 0.0
        for place in self._places:
            goal = place.copy()
            if not self._world:
                goal[:2] = x + cos * place[0] - sin * place[1], y + sin * place[0] + cos * place[1]
                goal[2] += yaw
            turn = as_turn(float(goal[2] - here[2]))
            goal[2] = here[2] + turn
            way, turned = way + math.hypot(*(goal - here)[:2]), turned + abs(turn)
            self._goals.append(goal)
            here = goal
        if self._duration:
            limits = body.controller.base.geometry
            need = max(way / limits.linear_velocity, turned / limits.angular_velocity)
            self._share = min(1.0, max(need / self._duration, 0.02))

    def step(self, body: Body) -> bool:
        """Command the velocity of this cycle."""
        goal = self._goals[0]
        x, y, yaw = body.base_pose(False)
        dx, dy, turn = goal[0] - x, goal[1] - y, float(goal[2] - yaw)
        way = math.hypot(dx, dy)
        twist = body.controller.twist
        standing = bool(np.abs(twist).max() < 0.02)
        if way < NEAR and abs(turn) < TURNED and (standing or len(self._goals) > 1):
            self._goals.pop(0)
            return bool(self._goals)
        limits = body.controller.base.geometry
        speed = self._speed(way, limits.linear_velocity, limits.linear_acceleration)
        rate = self._speed(abs(turn), limits.angular_velocity, limits.angular_acceleration)
        cos, sin = math.cos(yaw), math.sin(yaw)
        scale = speed / way if way > 1e-9 else 0.0
        command = np.array(
            [scale * (cos * dx + sin * dy), scale * (-sin * dx + cos * dy), math.copysign(rate, turn)]
        )
        if body.blocked(command):
            command[:] = 0.0
            self._stuck += 1
            if self._stuck * CYCLE > 2.0:
                self.error = "an obstacle is nearer than the security distance"
                return False
        else:
            self._stuck = 0
        body.controller.command(command)
        return True

    def _speed(self, left: float, fastest: float, strongest: float) -> float:
        """Return v = min(v_max, sqrt(a d)): half of the maximum deceleration, so that the ramp can follow."""
        return min(self._share * fastest, math.sqrt(strongest * left), left / CYCLE)

    def finish(self, body: Body) -> None:
        """Brake."""
        body.controller.command((0.0, 0.0, 0.0))
