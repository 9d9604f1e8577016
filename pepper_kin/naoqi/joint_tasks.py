"""Tasks that move joints along curves through keys or to targets, and tasks that change the stiffness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.simulation.target_following import time_to_target, way_to_target
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.key_curve import Key, curve_segments

if TYPE_CHECKING:
    from pepper_kin.naoqi.body import Body

_SETTLED = 1e-4  # [rad or fraction]; error below which a command counts as reached
_LONGEST_SLIDE = 3.0  # [s]; maximum time that a task waits for an arm that slides along an obstacle


class CurveTask(BodyTask):
    """Move joints along curves of time through keys.

    Args:
        name: Name of the method that started the task.
        keys: Joint -> its keys in order of time; angles are absolute or, with `relative`, changes.
        relative: Whether angles are changes from the commands at the start.
    """

    def __init__(self, name: str, keys: Mapping[str, tuple[Key, ...]], relative: bool = False) -> None:
        super().__init__(name, keys)
        self.keys, self.relative = keys, relative
        self.duration = max(curve[-1].time for curve in keys.values())
        self._elapsed = 0.0
        self._curves: dict[str, tuple[Array, Array]] = {}
        self._ends: dict[str, float] = {}

    def start(self, body: Body) -> None:
        """Compute the curves from the present commands."""
        for joint, keys in self.keys.items():
            begin = body.commanded(joint)
            offset = begin if self.relative else 0.0
            placed = tuple(
                Key(key.time, body.clipped(joint, key.value + offset), key.before, key.behind) for key in keys
            )
            self._curves[joint] = curve_segments(placed, begin, max(self.duration, CYCLE))
            self._ends[joint] = placed[-1].value

    def step(self, body: Body) -> bool:
        """Command the values of the next cycle; after the end, wait for joints behind by velocity limits."""
        self._elapsed += CYCLE
        if self._elapsed < self.duration + 1e-9:
            for joint, (breaks, powers) in self._curves.items():
                body.command[body.index[joint]] = value_at(breaks, powers, self._elapsed)
            return True  # the twin reaches the last command a cycle later
        for joint, end in self._ends.items():
            body.command[body.index[joint]] = end
        return self._behind(body)

    def _behind(self, body: Body) -> bool:
        """Return whether a joint with its motor on is behind its end by velocity limits, or an arm slides."""
        most = body.velocity_limits
        may_slide = self._elapsed < self.duration + _LONGEST_SLIDE
        return any(
            abs(end - body.last_command(joint)) > most[joint] * CYCLE + _SETTLED
            or (may_slide and body.slides(joint))
            for joint, end in self._ends.items()
            if not body.is_limp(joint) and not body.is_held(joint)
        )


def value_at(breaks: Array, powers: Array, time: float) -> float:
    """Return the value of a piecewise cubic at a time.

    Args:
        breaks: Start of each cubic, and the end [s], shape (m + 1,).
        powers: Coefficients in the time since the break, constant first, shape (m, p).
        time: Time [s], held within the breaks.
    """
    k = int(np.clip(np.searchsorted(breaks, time, side="right") - 1, 0, len(powers) - 1))
    s = min(time, float(breaks[-1])) - float(breaks[k])
    return float(np.polynomial.polynomial.polyval(s, powers[k]))


class TrajectoryTask(BodyTask):
    """Move joints along a trajectory, after an approach to its start; joints that it does not move are free.

    Args:
        name: Name of the method that started the task.
        trajectory: Trajectory of joints of the body [rad].
    """

    def __init__(self, name: str, trajectory: Trajectory) -> None:
        moved = (
            np.ptp(trajectory.coefficients[:, 0], axis=0)
            + np.abs(trajectory.coefficients[:, 1:]).max(axis=(0, 1), initial=0.0)
            > 1e-9
        )
        self._columns = {joint: k for k, joint in enumerate(trajectory.joint_names) if moved[k]}
        super().__init__(name, self._columns)
        self._trajectory = trajectory
        self._elapsed = 0.0
        self._approach: CurveTask | None = None

    def start(self, body: Body) -> None:
        """Start an approach to the start of the trajectory, if the joints are not there."""
        first = {joint: float(self._trajectory.coefficients[0, 0, k]) for joint, k in self._columns.items()}
        need = max(
            abs(angle - body.commanded(j)) / (0.2 * body.velocity_limits[j]) for j, angle in first.items()
        )
        if need > CYCLE:
            self._approach = CurveTask(self.name, {j: (Key(1.5 * need, a),) for j, a in first.items()})
            self._approach.start(body)

    def step(self, body: Body) -> bool:
        """Command the values of the next cycle."""
        if self._approach is not None:
            if self._approach.step(body):
                return True
            self._approach = None
        self._elapsed += CYCLE
        for joint, k in self._columns.items():
            powers = self._trajectory.coefficients[:, :, k]
            body.command[body.index[joint]] = value_at(self._trajectory.breaks, powers, self._elapsed)
        return self._elapsed < self._trajectory.duration + CYCLE


class SpeedTask(BodyTask):
    """Move joints to targets with a fraction of their maximum speed (`setAngles`, `changeAngles`).

    Each joint moves along a cubic in time; see `pepper_kin.core.simulation.target_following`.

    Args:
        name: Name of the method that started the task.
        targets: Joint -> target [rad or fraction].
        share: Fraction of the maximum speed, 0 to 1; 0 keeps the joints.
        reactive: Whether a later call may take joints away.
    """

    def __init__(
        self, name: str, targets: Mapping[str, float], share: float, *, reactive: bool = True
    ) -> None:
        super().__init__(name, targets, reactive=reactive)
        self.targets, self.share = dict(targets), share
        self._elapsed = 0.0
        self._curves: dict[str, tuple[float, float, float, float, float]] = {}

    def step(self, body: Body) -> bool:
        """Move the commands of the joints that the task still has."""
        going = False
        for joint in tuple(self.resources):
            if body.is_limp(joint) or self.share == 0.0:
                self._curves.pop(joint, None)
                going = going or self.share == 0.0
                continue
            if joint not in self._curves:
                self._curves[joint] = (self._elapsed, *self._curve(body, joint))
            began, origin, way, speed, duration = self._curves[joint]
            elapsed = self._elapsed + CYCLE - began
            body.command[body.index[joint]] = origin + way_to_target(way, speed, duration, elapsed)
            slides = body.slides(joint) and elapsed < duration + _LONGEST_SLIDE
            going = going or slides or (elapsed < duration and not body.is_held(joint))
        self._elapsed += CYCLE
        return going

    def _curve(self, body: Body, joint: str) -> tuple[float, float, float, float]:
        """Return origin, displacement, initial speed and duration [s] of the cubic to a joint's target."""
        k = body.index[joint]
        origin, speed = float(body.command[k]), body.command_rate(joint)
        way = body.clipped(joint, self.targets[joint]) - origin
        fastest = self.share * float(body.response.speed_share[k] * body.pepper.velocity_limits[k])
        duration = time_to_target(way, speed, fastest, float(body.pepper.acceleration_limits[k]))
        return origin, way, speed, duration


class StiffnessTask(BodyTask):
    """Change the stiffness of joints along lines through keys.

    Args:
        keys: Joint -> times [s], and stiffness at each time.
    """

    def __init__(self, keys: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> None:
        super().__init__("stiffnessInterpolation", ())
        self.keys = keys
        self._elapsed = 0.0
        self._begin: dict[str, float] = {}

    def start(self, body: Body) -> None:
        """Start from the present stiffness."""
        self._begin = {joint: body.stiffness[joint] for joint in self.keys}

    def step(self, body: Body) -> bool:
        """Set the stiffness of this cycle."""
        self._elapsed += CYCLE
        body.set_stiffness(
            {
                joint: float(np.interp(self._elapsed, [0.0, *times], [self._begin[joint], *values]))
                for joint, (times, values) in self.keys.items()
            }
        )
        return self._elapsed < max(times[-1] for times, _ in self.keys.values()) - 1e-9
