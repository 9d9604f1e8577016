"""Replay of the paper's movements on the twin, with errors compared with the paper's."""

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
    """One of the paper's movements on the twin; arrays are read-only.

    Attributes:
        gesture: The movement and the paper's values.
        trajectory: The timed movement.
        run: Run of the twin.
        key_times: Times at which the trajectory passes the keyframes [s], shape (5,).
        commanded: Plan clipped to the joint limits [rad], shape (5, k).
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
        """Mean absolute error of measured against commanded positions at the keyframes [rad], shape (k,)."""
        return np.abs(self.measured - self.commanded).mean(axis=0)

    @property
    def plan_error(self) -> Array:
        """Mean absolute error of measured positions against the unclipped plan [rad], shape (k,)."""
        return np.abs(self.measured - self.gesture.plan).mean(axis=0)

    @property
    def limit_violation(self) -> Array:
        """Distance of the paper's plan outside the joint limits [rad], shape (5, k)."""
        return np.abs(self.gesture.plan - self.commanded)

    @property
    def rms_tracking_error(self) -> Array:
        """Root mean square tracking error of the gesture's joints over the movement [rad], shape (k,)."""
        places = [self.run.joint_names.index(name) for name in self.gesture.joint_names]
        return self.run.rms_error[places]

    def report(self) -> str:
        """Return the table of errors with a legend, as text."""
        gesture = self.gesture
        lines = [
            f"Movement {gesture.name!r} of the paper's table 5: {self.trajectory.duration:.3f} s, "
            "keyframes at "
            + ", ".join(f"{t:.3f}" for t in self.key_times)
            + f" s; run {self.run.status.value}",
            "Mean absolute error against the plan at five keyframes [rad]:",
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
        """Return sentences on changes of the plan, and on inconsistencies in the paper's table."""
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
    """Run one of the paper's movements on the twin and compare it with the paper's table 5.

    The plan's five keyframes, clipped to the joint limits, are joined by a spline and timed as fast as all
    limits allow, without motion of other joints. The twin follows the trajectory, and its positions are read
    at the times of the keyframes.

    Args:
        pepper: Pepper.
        name: "left-arm", "right-arm" or "head".
        twin: The twin to use; a new one if omitted.
        duration: Duration of the movement [s], at least the minimum; the minimum if omitted.

    Returns:
        The report, with trajectory and run.

    Raises:
        UnknownNameError: for another gesture, or a robot without its joints.
        InfeasibleError: if `duration` is less than the minimum.
    """
    gesture = paper_gesture(name)
    places = [pepper.joint_index(joint) for joint in gesture.joint_names]
    points = np.tile(pepper.neutral(), (len(FRAMES), 1))
    points[:, places] = np.clip(gesture.plan, pepper.lower_limits[places], pepper.upper_limits[places])
    trajectory = retime(pepper, points, duration=duration, balance=None, torque_scale=1.0)
    key_times = passing_times(trajectory, points)
    run = (twin if twin is not None else Twin(pepper)).execute(trajectory)
    reached = np.minimum(key_times, run.duration)  # earlier than the key times only if the run stopped
    measured = run.position_at(reached)[:, places]
    return GestureReport(gesture, trajectory, run, key_times, points[:, places], measured)


def passing_times(trajectory: Trajectory, points: Array) -> Array:
    """Return the times at which a trajectory of `retime` passes its waypoints [s], shape (k,).

    The time scaling keeps every waypoint as a knot; the knots are matched in order.
    """
    at_knots = trajectory(trajectory.knots).position
    times, first = [], 0
    for point in points:
        distance = np.abs(at_knots[first:] - point).max(axis=1)
        first += int(np.argmax(distance <= distance.min() + 1e-9))
        times.append(trajectory.knots[first])
    return np.array(times)
