"""Tasks that move joints: along curves through keys, towards targets, and the stiffness."""

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

_SETTLED = 1e-4  # [rad or share]
_LONGEST_SLIDE = 3.0  # [s] that a task waits for an arm that slides along what it was kept from


class CurveTask(BodyTask):
    """Joints along curves of time through keys.

    Args:
        name: Method that began it.
        keys: Joint -> its keys in order of time, angles absolute or, with `relative`, from where it starts.
        relative: Whether angles are changes.
    """

    def __init__(self, name: str, keys: Mapping[str, tuple[Key, ...]], relative: bool = False) -> None:
        super().__init__(name, keys)
        self.keys, self.relative = keys, relative
        self.duration = max(curve[-1].time for curve in keys.values())
        self._elapsed = 0.0
        self._curves: dict[str, tuple[Array, Array]] = {}
        self._ends: dict[str, float] = {}

    def start(self, body: Body) -> None:
        """Lay the curves from the present commands."""
        for joint, keys in self.keys.items():
            begin = body.commanded(joint)
            offset = begin if self.relative else 0.0
            placed = tuple(
                Key(key.time, body.clipped(joint, key.value + offset), key.before, key.behind) for key in keys
            )
            self._curves[joint] = curve_segments(placed, begin, max(self.duration, CYCLE))
            self._ends[joint] = placed[-1].value

    def step(self, body: Body) -> bool:
        """Command the values of one cycle later; at the end wait for what the limits of speed held back."""
        self._elapsed += CYCLE
        if self._elapsed < self.duration + 1e-9:
            for joint, (breaks, powers) in self._curves.items():
                body.command[body.index[joint]] = value_at(breaks, powers, self._elapsed)
            return True  # the twin has the last command a cycle later
        for joint, end in self._ends.items():
            body.command[body.index[joint]] = end
        return self._behind(body)

    def _behind(self, body: Body) -> bool:
        """Return whether limits of speed hold back a joint whose motor is on, or a protected arm slides."""
        most = body.velocity_limits
        may_slide = self._elapsed < self.duration + _LONGEST_SLIDE
        return any(
            abs(end - body.last_command(joint)) > most[joint] * CYCLE + _SETTLED
            or (may_slide and body.slides(joint))
            for joint, end in self._ends.items()
            if not body.is_limp(joint) and not body.is_held(joint)
        )


def value_at(breaks: Array, powers: Array, time: float) -> float:
    """Return the value of cubics in time at a time.

    Args:
        breaks: Times where the cubics begin, and the end [s], shape (m + 1,).
        powers: Coefficients from the break, constant first, shape (m, p).
        time: [s].
    """
    k = int(np.clip(np.searchsorted(breaks, time, side="right") - 1, 0, len(powers) - 1))
    s = min(time, float(breaks[-1])) - float(breaks[k])
    return float(np.polynomial.polynomial.polyval(s, powers[k]))


class TrajectoryTask(BodyTask):
    """The joints that a trajectory moves along it, from wherever they are.

    Args:
        name: Method that began it.
        trajectory: Of joints of the body [rad].
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
        """Approach the start of the trajectory, if the joints are elsewhere."""
        first = {joint: float(self._trajectory.coefficients[0, 0, k]) for joint, k in self._columns.items()}
        need = max(
            abs(angle - body.commanded(j)) / (0.2 * body.velocity_limits[j]) for j, angle in first.items()
        )
        if need > CYCLE:
            self._approach = CurveTask(self.name, {j: (Key(1.5 * need, a),) for j, a in first.items()})
            self._approach.start(body)

    def step(self, body: Body) -> bool:
        """Command the values of one cycle later."""
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
    """Joints to targets with a share of their fastest speed (`setAngles`, `changeAngles`).

    Each goes along a cubic in time; see `pepper_kin.core.simulation.target_following`.

    Args:
        name: Method that began it.
        targets: Joint -> angle [rad or share].
        share: Of the fastest speed, above 0 and at most 1.
        reactive: Whether a later call takes its joints away.
    """

    def __init__(
        self, name: str, targets: Mapping[str, float], share: float, *, reactive: bool = True
    ) -> None:
        super().__init__(name, targets, reactive=reactive)
        self.targets, self.share = dict(targets), share
        self._elapsed = 0.0
        self._curves: dict[str, tuple[float, float, float, float, float]] = {}

    def step(self, body: Body) -> bool:
        """Move the commands of the joints that it still has."""
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
        """Return origin, way, speed and duration of the cubic to a joint's target."""
        k = body.index[joint]
        origin, speed = float(body.command[k]), body.command_rate(joint)
        way = body.clipped(joint, self.targets[joint]) - origin
        fastest = self.share * float(body.response.speed_share[k] * body.pepper.velocity_limits[k])
        duration = time_to_target(way, speed, fastest, float(body.pepper.acceleration_limits[k]))
        return origin, way, speed, duration


class StiffnessTask(BodyTask):
    """Stiffness of joints along lines through keys.

    Args:
        keys: Joint -> times [s] and stiffness.
    """

    def __init__(self, keys: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> None:
        super().__init__("stiffnessInterpolation", ())
        self.keys = keys
        self._elapsed = 0.0
        self._begin: dict[str, float] = {}

    def start(self, body: Body) -> None:
        """Begin with the stiffness of now."""
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
