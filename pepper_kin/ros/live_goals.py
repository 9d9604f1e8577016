"""Goals of trajectories that a live motion reaches one after the other, without stops in between."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, contacts
from pepper_kin.collision.tracking import SceneTracker
from pepper_kin.exceptions import PepperKinError
from pepper_kin.model.requirements import checked_share
from pepper_kin.motion import LiveMotion, LiveState, LiveStatus
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.ros.joint_trajectory import ErrorCode, JointTolerance, TrajectoryRefusedError
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.samples import State

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body

STEP_EVERY = 2
"""Number of the body's cycles per cycle of the live motion."""

DELAY = 0.1
"""Maximum delay of the body's joints behind their commands [s]."""

_THERE, _STILL = 1e-6, 1e-6  # [rad or m], [rad/s or m/s]; position error and velocity at a goal


class LiveGoal(BodyTask):
    """The joints of a trajectory to its end, by a live motion, watched by tolerances; see `ControllerTask`.

    Args:
        drive: What moves the joints.
        trajectory: Of joints of the body, to rest.
        path: Tolerance on the way, which is that of the live motion.
        goal: Tolerance at the end.
        goal_time: Time after the arrival in which the goal's tolerance must be met [s].
        delay: Time until it begins [s].
        patience: Time after the trajectory's duration in which it has to arrive [s].

    Attributes:
        on_step: Called after each cycle with the time since the begin [s], desired and actual state.
        outcome: The code, None where it did not come to its end, and a sentence.
    """

    def __init__(
        self,
        drive: LiveDrive,
        trajectory: Trajectory,
        path: JointTolerance,
        goal: JointTolerance,
        goal_time: float,
        *,
        delay: float,
        patience: float,
    ) -> None:
        super().__init__("follow_joint_trajectory", trajectory.joint_names)
        self._drive, self._trajectory, pepper = drive, trajectory, drive.body.pepper
        self._path, self._goal, self._goal_time = path, goal, goal_time
        self._names, self._until = trajectory.joint_names, trajectory.duration + patience
        self._rows = [drive.body.index[name] for name in trajectory.joint_names]
        self._end = np.clip(trajectory.end, pepper.lower_limits[self._rows], pepper.upper_limits[self._rows])
        self._elapsed, self._arrived, self._aims = -delay, 0.0, False
        self.on_step: Callable[[float, State, State], object] | None = None
        self.outcome: tuple[ErrorCode | None, str] = (None, "it was replaced or stopped")

    @property
    def progress(self) -> float:
        """Fraction of the trajectory's duration that has passed, 0 to 1."""
        return 1.0 if self._arrived else min(max(self._elapsed / self._trajectory.duration, 0.0), 1.0)

    def step(self, body: Body) -> bool:
        """Start when due, then check the joints' errors; the drive moves the joints."""
        if not self._aims:
            self._aims = self._elapsed >= 0.0 and self._drive.aim(self._rows, self._trajectory, self._end)
            self._elapsed += CYCLE if self._elapsed < 0.0 else 0.0
            return True
        self._drive.step()
        state, rows = body.state, self._rows
        desired = State(*(part[rows] for part in self._drive.wanted))
        actual = State(state.position[rows], state.velocity[rows], state.acceleration[rows])
        if self.on_step is not None:
            self.on_step(self._elapsed, desired, actual)
        self.outcome = self._decided(desired, actual) or self.outcome
        self._elapsed += CYCLE
        return self.outcome[0] is None

    def _decided(self, desired: State, actual: State) -> tuple[ErrorCode, str] | None:
        """Return the result code and a sentence if the goal ends now, else None."""
        drive, names, after = self._drive, self._names, f"aborted {self._elapsed:.2f} s after its begin"
        error, rate = desired.position - actual.position, desired.velocity - actual.velocity
        there = np.abs(desired.position - self._end).max() <= _THERE
        wrong = drive.fault or ("" if there else self._path.violated(names, error, rate))
        if wrong:
            return ErrorCode.PATH_TOLERANCE_VIOLATED, f"{after}: {wrong}"
        if not there or np.abs(desired.velocity).max() > _STILL:
            if self._elapsed <= self._until:
                return None
            text = f"{after}, {self._until:g} s are allowed: {drive.reason or 'it is still on its way'}"
            return ErrorCode.GOAL_TOLERANCE_VIOLATED, text
        wrong = self._goal.violated(names, error, rate)
        if not wrong:
            return ErrorCode.SUCCESSFUL, "goal reached"
        self._arrived += CYCLE
        if 0.0 < self._goal_time < self._arrived:
            text = f"aborted {self._arrived:.2f} s after its end, {self._goal_time:g} s are allowed: {wrong}"
            return ErrorCode.GOAL_TOLERANCE_VIOLATED, text
        return None

    def finish(self, body: Body) -> None:
        """Stop the joints, unless the goal was reached."""
        if self._aims and self.outcome[0] is not ErrorCode.SUCCESSFUL:
            self._drive.release(self, self._rows)
        if self._aims and self._drive.moves:
            body.tasks.add(LiveBrake(self._drive, self._names))


class LiveBrake(BodyTask):
    """Brake the joints of an ended goal until the live motion is at rest.

    Args:
        drive: The live motion of the joints.
        joints: Names of the joints.
    """

    def __init__(self, drive: LiveDrive, joints: Sequence[str]) -> None:
        super().__init__("live_brake", joints, reactive=True)
        self._drive = drive

    def step(self, body: Body) -> bool:
        """Advance the live motion; return whether it still moves."""
        self._drive.step()
        return self._drive.moves

    def finish(self, body: Body) -> None:
        """Continue with the joints that no other task takes over."""
        if self.resources and self._drive.moves:
            body.tasks.add(LiveBrake(self._drive, sorted(self.resources)))


class LiveDrive:
    """A live motion of a body's joints to the goals of all trajectories; see `LiveMotion`.

    It starts with the first goal, from rest, and ends when no goal is left and the robot is at rest.  The
    tasks of the goals advance it.  Moving objects of the scene are assumed to keep their recent velocity; see
    `SceneTracker`.

    Args:
        body: The simulated body.
        share: Fraction of the limits of velocity and acceleration, above 0 and up to 1.

    Attributes:
        body: The simulated body.
        wanted: Commanded position, velocity and acceleration, shape (n,) each.
        reason: Reason why the robot does not move to its goals; "" if it does.
        fault: Reason why the robot cannot reach its goals any more; "" if it can.

    Raises:
        InvalidValueError: for a share outside (0, 1].
    """

    def __init__(self, body: Body, share: float) -> None:
        part, pepper = checked_share("live", share), body.pepper
        self._pepper = pepper.with_limits(
            velocity=part * pepper.velocity_limits, acceleration=part * pepper.acceleration_limits
        )
        self.body, self.reason, self.fault = body, "", ""
        self._rows = [body.index[name] for name in ACTUATED]
        self._tracker, self._cycles, self._stepped = SceneTracker(), 0, -np.inf
        self._live: LiveMotion | None = None
        self._state: LiveState | None = None
        still = np.zeros(pepper.n)
        self.wanted = State(body.configuration(False), still, still)

    def goal(
        self,
        trajectory: Trajectory,
        path: JointTolerance,
        goal: JointTolerance,
        goal_time: float,
        *,
        delay: float,
        patience: float,
    ) -> LiveGoal:
        """Return the task of a trajectory; the arguments are those of `LiveGoal`.  The body's lock is held.

        Raises:
            TrajectoryRefusedError: if the robot would touch itself at its end.
        """
        live = self._running()
        q = self.body.configuration(False) if live is None else self._aimed(live)
        q[[self.body.index[name] for name in trajectory.joint_names]] = trajectory.end
        touching = contacts(self._pepper, q)
        if touching:
            reason = f"at its end {' and '.join(touching[0].names)} would touch"
            raise TrajectoryRefusedError(ErrorCode.INVALID_GOAL, reason)
        return LiveGoal(self, trajectory, path, goal, goal_time, delay=delay, patience=patience)

    def aim(self, rows: Sequence[int], trajectory: Trajectory, end: Array) -> bool:
        """Set the end of a trajectory of joints as goal, along the trajectory if no other joint moves.

        Args:
            rows: Indices of the joints.
            trajectory: Trajectory of the joints.
            end: End of the trajectory, clipped to the limits, shape (k,).

        Returns:
            Whether the goal was set, or a fault found; False while joints still brake from an earlier motion.
        """
        body, live = self.body, self._running()
        if live is None:
            self._live = None
            if any(body.command_rate(name) for name in ACTUATED) or not body.controller.stands:
                return False  # they brake from an earlier motion
            self.reason = self.fault = ""
            try:
                live = self._live = LiveMotion(
                    self._pepper, body.configuration(False), self._seen(), rate=1.0 / (STEP_EVERY * CYCLE),
                    delay=DELAY,
                )  # fmt: skip
            except PepperKinError as error:
                self.fault = str(error)
                return True
            self._cycles, self._stepped = 0, body.time.now - CYCLE
        goal, here = self._aimed(live), live.trajectory.start
        goal[rows] = end
        others = np.delete(np.arange(goal.size), rows)
        way = None
        if np.array_equal(goal[others], here[others]) and np.array_equal(trajectory.end, end):
            count, order, _ = trajectory.coefficients.shape
            coefficients = np.zeros((count, order, goal.size))
            coefficients[:, 0], coefficients[:, :, rows] = here, trajectory.coefficients
            units = self._pepper.joint_units
            way = Trajectory(self._pepper.joint_names, trajectory.breaks, coefficients, units)
            goal = way.end
        live.set_goal(goal, way)
        return True

    def _running(self) -> LiveMotion | None:
        """Return the live motion if it commanded the last cycle."""
        return self._live if self._stepped > self.body.time.now - 1.5 * CYCLE else None

    @property
    def moves(self) -> bool:
        """Whether a joint is commanded to move."""
        return bool(np.abs(self.wanted.velocity).max() > _STILL)

    def release(self, ended: LiveGoal, rows: Sequence[int]) -> None:
        """Stop the joints of a goal; called with the body's lock held."""
        if self._live is not None and self._live.goal is not None:
            goal = self._aimed(self._live)
            goal[rows] = self._live.trajectory.end[rows]
            self._live.set_goal(goal if self._goals() - {ended} else None)

    def step(self) -> None:
        """Command this cycle of the body, unless done before; called with the body's lock held."""
        body, live = self.body, self._live
        now = body.time.now
        if live is None or now == self._stepped:
            return
        self._stepped = now
        busy = [task for task in body.tasks if task.started and not isinstance(task, LiveGoal | LiveBrake)]
        if busy and not self.fault:
            self.fault = f"{busy[0].name} moves {', '.join(sorted(busy[0].resources))}"
        if self._cycles % STEP_EVERY == 0:
            self._plan(live, now)
        self._cycles += 1
        assert self._state is not None
        self.wanted = self._state.at(now + CYCLE)
        taken = {body.index.get(name) for task in busy for name in task.resources}
        free = [k for k in self._rows if k not in taken]
        body.command[free] = self.wanted.position[free]

    def _plan(self, live: LiveMotion, now: float) -> None:
        """Do a cycle of the live motion in the present world; errors become the fault."""
        try:
            live.set_scene(self._seen(), now)
        except PepperKinError as error:
            self.fault = self.fault or str(error)
        if self.fault:
            live.set_goal(None)
        live.set_state(self.body.state.position, now)
        self._state = state = live.step(now)
        self.reason = state.reason
        if state.status is LiveStatus.HALTED:
            self.fault = self.fault or state.reason

    def _seen(self) -> Scene:
        return self._tracker.seen(self.body.scene or Scene(), self.body.time.now)

    def _goals(self) -> set[BodyTask]:
        return {task for task in self.body.tasks if isinstance(task, LiveGoal) and task.started}

    def _aimed(self, live: LiveMotion) -> Array:
        """Return the goal of a live motion, or where it will stop [rad or m], shape (n,)."""
        return np.array(live.trajectory.end if live.goal is None else live.goal)
