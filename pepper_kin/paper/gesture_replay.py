"""Replay of the paper's movements on the twin, with errors beside those that the paper reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.model import PepperModel
from pepper_kin.paper.table5 import FRAMES, PaperGesture, paper_gesture, paper_inconsistencies
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.twin import Run, Twin


@dataclass(frozen=True, eq=False)
class GestureReport(FrozenArrays):
    """One of the paper's movements as the twin made it; arrays are read-only.

    Attributes:
        gesture: The movement and what the paper reports.
        trajectory: The timed movement.
        run: What the twin did.
        key_times: When the trajectory passes the key frames [s], shape (5,).
        commanded: The plan moved into the joint limits [rad], shape (5, k).
        measured: Positions of the twin at the key times [rad], shape (5, k).
    """

    gesture: PaperGesture
    trajectory: Trajectory
    run: Run
    key_times: Array
    commanded: Array
    measured: Array

    def __post_init__(self) -> None:
        for name in ("key_times", "commanded", "measured"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def mean_absolute_error(self) -> Array:
        """Of measured against commanded over the key frames, per joint [rad], shape (k,)."""
        return np.abs(self.measured - self.commanded).mean(axis=0)

    @property
    def plan_error(self) -> Array:
        """Of measured against the paper's plan, what lies outside the limits included [rad], shape (k,)."""
        return np.abs(self.measured - self.gesture.plan).mean(axis=0)

    @property
    def limit_violation(self) -> Array:
        """How far the paper's plan lies outside the joint limits [rad], shape (5, k)."""
        return np.abs(self.gesture.plan - self.commanded)

    @property
    def rms_tracking_error(self) -> Array:
        """Over the whole movement, per joint of the gesture [rad], shape (k,)."""
        places = [self.run.joint_names.index(name) for name in self.gesture.joint_names]
        return self.run.rms_error[places]

    def report(self) -> str:
        """Return the table of errors with a legend, as text."""
        gesture = self.gesture
        lines = [
            f"Movement {gesture.name!r} of the paper's table 5: {self.trajectory.duration:.3f} s, "
            "key frames at "
            + ", ".join(f"{t:.3f}" for t in self.key_times)
            + f" s; run {self.run.status.value}",
            "Mean absolute error against the plan at five key frames [rad]:",
            f"  {'joint':<16}{'ours':>12}{'paper: Gazebo':>16}{'paper: Reality':>16}"
            f"{'ours, rms over time':>22}",
        ]
        gazebo, reality = gesture.paper_error("gazebo"), gesture.paper_error("reality")
        lines += [
            f"  {name:<16}{self.mean_absolute_error[j]:>12.6f}{gazebo[j]:>16.3f}{reality[j]:>16.3f}"
            f"{self.rms_tracking_error[j]:>22.6f}"
            for j, name in enumerate(gesture.joint_names)
        ]
        lines += [f"  {sentence}" for sentence in self.notes()]
        return "\n".join(lines)

    def notes(self) -> tuple[str, ...]:
        """Return what was changed in the plan, and what is inconsistent in the paper's table."""
        notes = []
        for frame, joint in np.argwhere(self.limit_violation > 0):
            notes.append(
                f"{FRAMES[frame]} of {self.gesture.joint_names[joint]}: the plan says "
                f"{self.gesture.plan[frame, joint]:.4f} rad, "
                f"{self.limit_violation[frame, joint]:.4f} outside "
                f"the joint's limits; commanded and compared: {self.commanded[frame, joint]:.4f}."
            )
        return (*notes, *paper_inconsistencies())

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        gesture = self.gesture
        joints = {
            name: {
                "printed_label": gesture.printed_labels[j],
                "plan": gesture.plan[:, j].tolist(),
                "commanded": self.commanded[:, j].tolist(),
                "measured": self.measured[:, j].tolist(),
                "mean_absolute_error": float(self.mean_absolute_error[j]),
                "mean_absolute_error_against_plan_outside_limits": float(self.plan_error[j]),
                "rms_tracking_error": float(self.rms_tracking_error[j]),
                "paper_gazebo_error": float(gesture.paper_error("gazebo")[j]),
                "paper_reality_error": float(gesture.paper_error("reality")[j]),
            }
            for j, name in enumerate(gesture.joint_names)
        }
        return {
            "gesture": gesture.name,
            "status": self.run.status.value,
            "unit": "rad",
            "duration": self.trajectory.duration,
            "key_times": self.key_times.tolist(),
            "joints": joints,
            "notes": list(self.notes()),
        }


def replay(
    pepper: PepperModel, name: str, *, twin: Twin | None = None, duration: float | None = None
) -> GestureReport:
    """Make one of the paper's movements on the twin and compare it with the paper's table 5.

    The plan's five key frames, moved into the joint limits where they lie outside, are joined by a spline
    and timed as fast as all limits allow, the other joints standing still; the twin follows, and its
    positions are read when the trajectory passes the key frames.

    Args:
        pepper: Pepper.
        name: "left-arm", "right-arm" or "head".
        twin: The twin to use; a new one if omitted.
        duration: How long it is to take [s], at least the shortest time; the shortest if omitted.

    Returns:
        The report, with trajectory and run.

    Raises:
        UnknownNameError: for another gesture, or a robot without its joints.
        InfeasibleError: where `duration` is less than the shortest.
    """
    gesture = paper_gesture(name)
    places = [pepper.joint_index(joint) for joint in gesture.joint_names]
    points = np.tile(pepper.neutral(), (len(FRAMES), 1))
    points[:, places] = np.clip(gesture.plan, pepper.lower_limits[places], pepper.upper_limits[places])
    trajectory = retime(pepper, points, duration=duration, balance=None, torque_scale=1.0)
    key_times = passing_times(trajectory, points)
    run = (twin if twin is not None else Twin(pepper)).execute(trajectory)
    reached = np.minimum(key_times, run.duration)  # short of the end only where the run stopped
    measured = run.position_at(reached)[:, places]
    return GestureReport(gesture, trajectory, run, key_times, points[:, places], measured)


def passing_times(trajectory: Trajectory, points: Array) -> Array:
    """Return when a trajectory made by `retime` passes its way-points [s], shape (k,).

    The time law keeps every way-point as a knot; they are found in order.
    """
    at_knots = trajectory(trajectory.knots).position
    times, first = [], 0
    for point in points:
        distance = np.abs(at_knots[first:] - point).max(axis=1)
        first += int(np.argmax(distance <= distance.min() + 1e-9))
        times.append(trajectory.knots[first])
    return np.array(times)
