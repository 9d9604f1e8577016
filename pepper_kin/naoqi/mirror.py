"""A twin that follows the commands of a robot, for comparison with the robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.robot_state import BASE, RobotState, run_of_states
from pepper_kin.twin import Run, RunStatus, Twin, actuator_parameters

STEP = 0.005
"""Timestep of the twin [s]."""

GAP = 0.5
"""Time without a state after which the twin restarts at the robot's state [s]."""

LIMP = 1e-3
"""Stiffness below which a motor is off."""


class Mirror:
    """A twin that follows the commands of a robot, live or recorded.

        mirror = Mirror(robot.pepper)
        for state in robot.states(seconds=10.0):
            mirror.add(state)
        print(mirror.report())

    Commands are interpolated linearly between two states.  The base of the twin, and joints without
    stiffness, follow the robot's measured positions.

    Args:
        pepper: Model with the states' joints.

    Attributes:
        pepper: Model of the robot.
        restarts: Number of times that the twin was set to the robot's state: at the first state, after a
            gap of more than 0.5 s, and after its simulation stopped.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self.pepper = pepper
        self.restarts = 0
        self._base = [pepper.joint_index(name) for name in BASE if name in pepper.joint_names]
        self._yaw = [pepper.joint_index(name) for name in BASE[2:] if name in pepper.joint_names]
        parameters = actuator_parameters(pepper, "motor")
        self._twin = Twin(pepper, STEP, feedforward="inverse_dynamics", actuators=parameters)
        self._measured: list[RobotState] = []
        self._simulated: list[RobotState] = []
        self._last, self._rate = pepper.neutral(), np.zeros(pepper.n)
        self._reached = 0.0
        self._follow(STEP, self._last)  # loads machine code before the first state

    def __len__(self) -> int:
        return len(self._measured)

    def add(self, state: RobotState) -> Array:
        """Simulate the twin up to the time of a state; return measured minus simulated positions, shape (n,).

        Args:
            state: State of the robot, later than the last one.

        Raises:
            InvalidValueError: for a state of other joints, or one that is not later than the last.
        """
        if state.joint_names != self.pepper.joint_names:
            raise InvalidValueError("joints of the state", state.joint_names, str(self.pepper.joint_names))
        if self._measured and state.time <= self._measured[-1].time:
            last = self._measured[-1].time
            raise InvalidValueError("time of the state", state.time, f"more than {last:g} s, of the last")
        q, command = self._unwound(state)
        near = bool(self._measured) and state.time <= self._measured[-1].time + GAP
        if not (near and self._follow(state.time, command)):
            self._restart(state.time, q, command)
        self._measured.append(replace(state, q=q, command=command))
        self._simulated.append(
            replace(
                state,
                q=np.array(self._twin.state.position),
                command=command,
                velocity=np.array(self._twin.state.velocity),
                torque=np.array(self._twin.state.torque),
            )
        )
        return self.difference

    @property
    def difference(self) -> Array:
        """Measured minus simulated positions in the last state [rad, m or fraction], shape (n,).

        Raises:
            InvalidValueError: if no state was added.
        """
        if not self._measured:
            raise InvalidValueError("states", 0, "1 or more")
        return np.asarray(self._measured[-1].q - self._simulated[-1].q)

    @property
    def configuration(self) -> tuple[Array, Array]:
        """Measured and simulated positions of the last state [rad, m or fraction], shape (n,) each."""
        return self._measured[-1].q, self._simulated[-1].q

    def run(self) -> Run:
        """Return the measured and commanded motion as a run, in steps of 20 ms.

        Torques are zero if the robot reports none; `twin_run` has the twin's torques.

        Raises:
            InvalidValueError: if fewer than two states were added.
        """
        return self._run_of(self._measured)

    def twin_run(self) -> Run:
        """Return the twin's motion and the commands as a run, at the times of `run`.

        Raises:
            InvalidValueError: if fewer than two states were added.
        """
        return self._run_of(self._simulated)

    def report(self) -> str:
        """Return a table of each joint's deviation from the twin, largest first."""
        measured, simulated = self.run(), self.twin_run()
        off = measured.position - simulated.position
        rms, most = np.sqrt(np.mean(off**2, axis=0)), np.abs(off).max(axis=0)
        gaps = np.diff([state.time for state in self._measured])
        lines = [
            f"Mirror of {measured.duration:.2f} s: {len(self)} states, every {1e3 * np.median(gaps):.0f} ms, "
            f"at most {1e3 * gaps.max():.0f} ms apart; the twin began {self.restarts} times",
            f"  {'joint':<16}{'rms off':>12}{'most off':>12}{'rms error':>12}  (off: measured - twin; "
            "error: measured - commanded)",
        ]
        for k in np.argsort(-most, kind="stable"):
            name = self.pepper.joint_names[k]
            lines.append(f"  {name:<16}{rms[k]:>12.2e}{most[k]:>12.2e}{measured.rms_error[k]:>12.2e}")
        return "\n".join(lines)

    def _run_of(self, states: list[RobotState]) -> Run:
        if len(states) < 2:
            raise InvalidValueError("states", len(states), "2 or more")
        stamps = np.array([state.time for state in states]) - states[0].time
        return run_of_states(self.pepper, stamps, states, [state.command for state in states])

    def _unwound(self, state: RobotState) -> tuple[Array, Array]:
        """Return positions and commands with the yaw continued from the last state, shape (n,) each."""
        q = np.array(state.q)
        if self._measured:
            for k in self._yaw:
                last = self._measured[-1].q[k]
                q[k] = last + math.remainder(q[k] - last, 2.0 * math.pi)
        command = np.where((state.stiffness < LIMP) | np.isnan(state.command), q, state.command)
        command[self._base] = q[self._base]
        return q, np.clip(command, self.pepper.lower_limits, self.pepper.upper_limits)

    def _restart(self, time: float, q: Array, command: Array) -> None:
        """Restart the twin at positions, with commands, at a time.

        Args:
            time: Time of the state [s].
            q: Joint positions [rad, m or fraction], shape (n,).
            command: Commanded positions [rad, m or fraction], shape (n,).
        """
        self._twin.reset(np.clip(q, self.pepper.lower_limits, self.pepper.upper_limits))
        self._last, self._rate, self._reached = command, np.zeros(self.pepper.n), time
        self.restarts += 1

    def _follow(self, time: float, command: Array) -> bool:
        """Simulate the twin up to commands; return whether the simulation goes on.

        Args:
            time: Time of the commands [s].
            command: Commanded positions [rad, m or fraction], shape (n,).
        """
        rows = round((time - self._reached) / STEP)
        if rows < 1:
            return True
        rate = (command - self._last) / (rows * STEP)
        most = self.pepper.acceleration_limits
        acceleration = np.clip((rate - self._rate) / (rows * STEP), -most, most)
        share = (1.0 + np.arange(rows))[:, None] / rows
        run = self._twin.follow(
            self._last + share * (command - self._last),
            np.tile(rate, (rows, 1)),
            acceleration=np.tile(acceleration, (rows, 1)),
        )
        self._last, self._rate = command, rate
        self._reached += rows * STEP
        return run.status is not RunStatus.STOPPED


def states_of_run(run: Run) -> Iterator[RobotState]:
    """Yield a recorded run's states, for a `Mirror`: positions as measured, references as commands."""
    count = len(run.joint_names)
    nothing = np.full(count, np.nan)
    for row, time in enumerate(run.time):
        yield RobotState(
            run.joint_names,
            float(time),
            np.array(run.position[row]),
            np.array(run.reference_position[row]),
            np.array(run.velocity[row]),
            np.array(run.torque[row]),
            np.ones(count),
            nothing.copy(),
            float("nan"),
            {},
        )
