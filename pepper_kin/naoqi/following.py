"""Options and results of motions on a robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.supervision import RobotMotionStatus
from pepper_kin.twin import Run

SILENCE = 0.5
"""Default time without a client's heartbeat after which the watchdog stops the robot [s]."""


@dataclass(frozen=True)
class FollowOptions:
    """Options of following a motion.

    Attributes:
        joint_tolerance: Largest deviation of a joint [rad or fraction].
        base_tolerance: Largest deviation of the base [m].
        silence: Time without a heartbeat after which the watchdog stops the robot, and age of the last state
            beyond which the motion ends [s].
        hold_time: Maximum time for the robot to arrive after the end of the motion [s].
        lead: Time by which a target is sent early [s].
        base_gain: Gain from a deviation of the base to its correcting velocity [1/s].
    """

    joint_tolerance: float = 0.35
    base_tolerance: float = 0.15
    silence: float = SILENCE
    hold_time: float = 2.0
    lead: float = 0.04
    base_gain: float = 1.5


@dataclass(frozen=True, eq=False)
class RobotMotionResult(BriefRepr):
    """Outcome of a motion on a robot.

    Attributes:
        status: How the motion ended.
        message: Reason, if it did not complete, and what is missing if rest is not confirmed.
        at_rest: Whether the robot was measured at rest, with no task left that could move it.
        method: "stream", "bezier", "live", "drive" or "move_to".
        run: Measured and commanded positions, in steps of 20 ms; torques are zero if the robot
            reports none.  None if fewer than two states were read.
        stamps: Time at which each state was requested, from the start of the motion [s], shape (k,).
        guarded: Whether the robot has a watchdog.
    """

    status: RobotMotionStatus
    message: str
    at_rest: bool
    method: str
    run: Run | None
    stamps: Array
    guarded: bool

    @property
    def success(self) -> bool:
        """Whether the motion completed."""
        return self.status is RobotMotionStatus.COMPLETED

    def __bool__(self) -> bool:
        """Return whether the motion completed."""
        return self.success

    @property
    def delay(self) -> float:
        """Delay of the measured positions behind the commanded ones [s], from 0 to 0.3.

        The shift of the commands that minimizes the sum of the squared deviations.
        """
        if self.run is None:
            return float("nan")
        run = self.run
        shifts = np.arange(0.0, 0.3, 0.005)
        sums = []
        for shift in shifts:
            at = np.clip(run.time - shift, 0.0, None)
            late = [np.interp(at, run.time, column) for column in run.reference_position.T]
            sums.append(float(np.sum((run.position - np.array(late).T) ** 2)))
        return float(shifts[int(np.argmin(sums))])

    def report(self) -> str:
        """Return as text how the motion ended, how often states were read, and each joint's deviation."""
        why = f" ({self.message})" if self.message else ""
        lines = [f"Motion by {self.method}: {self.status.value}{why}", f"  {self.status.advice}"]
        lines.append(
            "  the robot was measured at rest" if self.at_rest else "  the robot MAY STILL MOVE: look at it"
        )
        if not self.guarded:
            lines.append("  no watchdog on the robot: without this process it goes on with its last command")
        if self.run is not None:
            gaps = np.diff(self.stamps)
            lines.append(
                f"  {len(self.stamps)} states, every {1e3 * np.median(gaps):.0f} ms, at most "
                f"{1e3 * gaps.max():.0f} ms apart; measured is {1e3 * self.delay:.0f} ms behind commanded"
            )
            lines.append(self.run.report())
        return "\n".join(lines)
