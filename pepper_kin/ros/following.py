"""Tasks of the simulated body for ROS: trajectory following, braking, driving by velocity commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.naoqi.base_tasks import VelocityTask
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.ros.joint_trajectory import ErrorCode, JointTolerance
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.samples import State

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body


class ControllerTask(BodyTask):
    """Moves joints along a trajectory and checks tolerances.

    Args:
        trajectory: Trajectory of joints of the body, from their present commands on.
        path: Tolerance along the trajectory.
        goal: Tolerance at the end.
        goal_time: Time after the end in which the goal's tolerance must be met [s]; 0 for any time.
        delay: Time until the trajectory begins [s].
        on_step: Function that is called after each cycle, with the lock held, with the time along the
            trajectory [s], the desired and the actual state.

    Attributes:
        outcome: Error code, None if the trajectory did not end, and a sentence.
        replaced: Whether another trajectory takes over the joints, so that they need not brake.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        path: JointTolerance,
        goal: JointTolerance,
        goal_time: float,
        *,
        delay: float = 0.0,
        on_step: Callable[[float, State, State], object] | None = None,
    ) -> None:
        super().__init__("follow_joint_trajectory", trajectory.joint_names)
        self.trajectory, self.path, self.goal, self.goal_time = trajectory, path, goal, goal_time
        self.on_step = on_step
        self.outcome: tuple[ErrorCode | None, str] = (None, "it was replaced or stopped")
        self._elapsed = -delay
        self._indices: list[int] = []
        self.replaced = False

    @property
    def progress(self) -> float:
        """Fraction of the duration that has passed, 0 to 1."""
        return min(max(self._elapsed / self.trajectory.duration, 0.0), 1.0)

    def start(self, body: Body) -> None:
        """Look up the indices of the joints."""
        self._indices = [body.index[name] for name in self.trajectory.joint_names]

    def step(self, body: Body) -> bool:
        """Check the tolerances, then command the positions of one cycle later."""
        desired = self._state(self._elapsed)
        state = body.state
        rows = self._indices
        actual = State(state.position[rows], state.velocity[rows], state.acceleration[rows])
        if self._elapsed >= 0.0:
            if self.on_step is not None:
                self.on_step(self._elapsed, desired, actual)
            if self._is_over(desired, actual):
                return False
        self._elapsed += CYCLE
        if self._elapsed > 0.0:
            body.command[rows] = self._state(self._elapsed).position
        return True

    def _is_over(self, desired: State, actual: State) -> bool:
        """Return whether the trajectory ends now, and set the outcome."""
        names = self.trajectory.joint_names
        error, rate = desired.position - actual.position, desired.velocity - actual.velocity
        late = self._elapsed - self.trajectory.duration
        if late < -1e-9:
            wrong = self.path.violated(names, error, rate)
            if wrong:
                self.outcome = (
                    ErrorCode.PATH_TOLERANCE_VIOLATED,
                    f"aborted {self._elapsed:.2f} s after its begin: {wrong}",
                )
            return bool(wrong)
        wrong = self.goal.violated(names, error, rate)
        if not wrong:
            self.outcome = (ErrorCode.SUCCESSFUL, "goal reached")
            return True
        if 0.0 < self.goal_time < late:
            self.outcome = (
                ErrorCode.GOAL_TOLERANCE_VIOLATED,
                f"aborted {late:.2f} s after its end, {self.goal_time:g} s are allowed: {wrong}",
            )
            return True
        return False

    def _state(self, time: float) -> State:
        return self.trajectory(min(max(time, 0.0), self.trajectory.duration))

    def finish(self, body: Body) -> None:
        """Brake, unless the goal was reached or another trajectory takes over."""
        if self.outcome[0] is not ErrorCode.SUCCESSFUL and not self.replaced:
            body.tasks.add(BrakeTask(self.trajectory.joint_names))


class BrakeTask(BodyTask):
    """Brakes joints from their present speed to rest, at the limits of acceleration.

    Args:
        joints: Names of the joints.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        super().__init__("brake", joints, reactive=True)
        self._rate: dict[str, float] = {}

    def start(self, body: Body) -> None:
        """Store the present speeds of the joints."""
        self._rate = {name: body.command_rate(name) for name in self.resources}

    def step(self, body: Body) -> bool:
        """Slow down the joints that the task still holds."""
        going = False
        for name in tuple(self.resources):
            k, rate = body.index[name], self._rate[name]
            most = float(body.pepper.acceleration_limits[k]) * CYCLE
            slower = float(np.sign(rate)) * max(abs(rate) - most, 0.0)
            self._rate[name] = slower
            body.command[k] = body.clipped(name, float(body.command[k]) + slower * CYCLE)
            going = going or slower != 0.0
        return going


class CmdVelTask(VelocityTask):
    """Drives the base at a velocity that must be commanded repeatedly; without commands the base brakes.

    Args:
        twist: v_x, v_y [m/s], omega [rad/s] in the axes of the base, shape (3,).
        timeout: Time for which a command holds [s].
    """

    def __init__(self, twist: ArrayLike, timeout: float) -> None:
        super().__init__("cmd_vel", np.asarray(twist, dtype=float).tolist())
        self.timeout = timeout
        self.expired = False
        self._age = 0.0

    def refresh(self, twist: ArrayLike) -> None:
        """Set another velocity, shape (3,), and restart the timeout."""
        self.twist = np.asarray(twist, dtype=float)
        self._age, self.expired = 0.0, False

    def step(self, body: Body) -> bool:
        """Command the velocity, or rest once the last command has expired."""
        self._age += CYCLE
        if self._age > self.timeout + 1e-9 and not self.expired:
            self.expired = True
            self.twist = np.zeros(3)
        return super().step(body)
