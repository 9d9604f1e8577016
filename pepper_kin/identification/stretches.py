"""Stretches of a log that no actuator explains, and their possible causes.

A reading is explained if some timing of the commanded motion is near it: if it is within a distance of the
range of the twin over a short time before and after.  Several unexplained readings in a row, over some time,
form a stretch, which extends while readings stay away by half of that distance.  A stretch is

* "beyond a limit" where the command lay beyond the joint's limit, or close to it, and the robot stayed short,
* "protected" where the commanded posture brings the joint's arm near the body, or another joint of the arm is
  protected at that time: the robot keeps its arms off, or they touch the body,
* "blocked" where the robot is at rest, away from the command,
* "unknown" otherwise: pushed, held, hot, or commanded by somebody else.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin import collision
from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.identification.robot_log import RobotLog
from pepper_kin.model import PepperModel

BEYOND, PROTECTED, BLOCKED, UNKNOWN = "beyond a limit", "protected", "blocked", "unknown"
KINDS = (BEYOND, PROTECTED, BLOCKED, UNKNOWN)
"""Kinds of a `Stretch`."""

STILL = 0.01
"""Distance from their middle within which four fifths of the readings of a robot at rest stay [rad]."""

NEAR_LIMIT = 0.03
"""Distance from a limit within which a command counts as at the limit [rad]."""

NEAR_BODY = 0.01
"""Clearance of its shapes below which a commanded arm counts as near the body [m]."""

_POSTURE = "Stand"


@dataclass(frozen=True)
class Tolerance:
    """Definition of a stretch.

    Attributes:
        within: Distance from the range of the twin above which a reading is unexplained [rad].
        timing: Half the time over which the range of the twin is taken [s].
        duration: Minimum duration of a stretch [s].
        readings: Minimum number of unexplained readings of a stretch.
    """

    within: float = 0.02
    timing: float = 0.04
    duration: float = 0.35
    readings: int = 2

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: for a number out of range.
        """
        for quantity in ("within", "timing", "duration", "readings"):
            value = getattr(self, quantity)
            if not (np.isfinite(value) and value >= 0) or (quantity == "within" and value == 0):
                raise InvalidValueError(quantity, value, "a finite number of at least 0, `within` above 0")


@dataclass(frozen=True)
class Stretch:
    """A period in which no actuator explains a joint's position.

    Attributes:
        joint: Name of the joint.
        begin: Time of the first reading of the stretch [s].
        end: Time of the last reading of the stretch [s].
        size: Maximum of |twin - robot| [rad].
        offset: Median of robot - command [rad].
        kind: One of `KINDS`.
    """

    joint: str
    begin: float
    end: float
    size: float
    offset: float
    kind: str

    @property
    def duration(self) -> float:
        """Time from the first to the last reading [s]."""
        return self.end - self.begin

    def as_dict(self) -> dict[str, float | str]:
        """Return the fields by name."""
        return asdict(self)

    def __str__(self) -> str:
        """Return one line."""
        away = f"{1e3 * self.offset:+.0f} mrad from the command"
        where = f"{self.begin:.1f} to {self.end:.1f} s"
        return f"{self.joint}, {where}: up to {1e3 * self.size:.0f} mrad, {away}, {self.kind}"


def find_stretches(
    pepper: PepperModel, log: RobotLog, twin: Array, unexplained: Array, tolerance: Tolerance
) -> tuple[tuple[Stretch, ...], NDArray[np.bool_]]:
    """Return the stretches of a log in order of time, and which readings are in one, shape (T, n).

    Args:
        pepper: The robot.
        log: Log of the robot.
        twin: Angles of the twin [rad], shape (T, n).
        unexplained: Distances of the readings from the range of the twin [rad], shape (T, n).
        tolerance: Definition of a stretch.
    """
    named = np.zeros(unexplained.shape, dtype=bool)
    found: list[Stretch] = []
    command = log.commands_at(log.time)
    for j, joint in enumerate(log.joint_names):
        for first, beyond in _runs(log.time, np.abs(unexplained[:, j]), tolerance):
            rows = slice(first, beyond)
            named[rows, j] = True
            away = log.measured[rows, j] - command[rows, j]
            found.append(
                Stretch(
                    joint,
                    float(log.time[first]),
                    float(log.time[beyond - 1]),
                    float(np.abs(twin[rows, j] - log.measured[rows, j]).max()),
                    float(np.median(away)),
                    _kind(pepper, log, command, (first, beyond), j),
                )
            )
    found = _with_their_arms(found)
    found.sort(key=lambda stretch: (stretch.begin, stretch.joint))
    return tuple(found), named


def _runs(time: Array, distance: Array, tolerance: Tolerance) -> list[tuple[int, int]]:
    """Return the first row of each stretch, and the row after its last.

    Args:
        time: Times of the readings [s], shape (T,).
        distance: Distances of the readings from the range of the twin [rad], shape (T,).
        tolerance: Definition of a stretch.
    """
    away = np.concatenate([[False], distance > 0.5 * tolerance.within, [False]])
    runs = np.flatnonzero(np.diff(away.astype(int))).reshape(-1, 2)
    chosen = []
    for first, beyond in runs:
        far = int((distance[first:beyond] > tolerance.within).sum())
        lasting = time[min(beyond, time.size - 1)] - time[first]
        if far and far >= tolerance.readings and lasting >= tolerance.duration:
            chosen.append((int(first), int(beyond)))
    return chosen


def _kind(pepper: PepperModel, log: RobotLog, command: Array, rows: tuple[int, int], j: int) -> str:
    """Return the kind of a stretch of the joint in column j."""
    k = pepper.joint_index(log.joint_names[j])
    first, beyond = rows
    given = command[first:beyond, j]
    reached = log.measured[first:beyond, j]
    lower, upper = float(pepper.lower_limits[k]), float(pepper.upper_limits[k])
    target = float(np.median(given))
    short = float(np.median(reached - given))
    if (target > upper - NEAR_LIMIT and short < 0) or (target < lower + NEAR_LIMIT and short > 0):
        return BEYOND
    if _arm_near_body(pepper, log, command[(first + beyond) // 2], log.joint_names[j]):
        return PROTECTED
    return BLOCKED if _is_still(reached) else UNKNOWN


def _with_their_arms(found: list[Stretch]) -> list[Stretch]:
    """Return stretches; an unknown one becomes protected if its arm is protected at that time."""
    protected = [one for one in found if one.kind == PROTECTED]
    return [
        replace(one, kind=PROTECTED)
        if one.kind == UNKNOWN and any(_is_of_arm_during(one, other) for other in protected)
        else one
        for one in found
    ]


def _is_of_arm_during(one: Stretch, other: Stretch) -> bool:
    same = one.joint[0] == other.joint[0] and _is_of_arm(one.joint) and _is_of_arm(other.joint)
    return same and one.begin <= other.end and other.begin <= one.end


def _is_of_arm(joint: str) -> bool:
    return joint[:1] in "LR" and joint[1:].startswith(("Shoulder", "Elbow", "Wrist"))


def _is_still(values: Array) -> bool:
    low, high = np.percentile(values, [10, 90])
    return bool(high - low <= 2 * STILL)


def _arm_near_body(pepper: PepperModel, log: RobotLog, command: Array, joint: str) -> bool:
    """Return whether a commanded posture brings the arm of a joint near another part of the robot."""
    shoulder = f"{joint[0]}ShoulderPitch"
    if shoulder not in pepper.joint_names or not _is_of_arm(joint):
        return False
    q = np.array(pepper.posture(_POSTURE) if _POSTURE in pepper.posture_names else pepper.neutral())
    for name, angle in zip(log.joint_names, command, strict=True):
        q[pepper.joint_index(name)] = angle
    q = np.clip(q, pepper.lower_limits, pepper.upper_limits)
    near = collision.near_pairs(pepper, q, NEAR_BODY)
    place, links = pepper.joint_index(shoulder), set(pepper.link_names)
    arm = {
        link
        for link in {name for pair in near.names for name in pair} & links
        if place in pepper.joints_above(link)
    }
    return any((a in arm) != (b in arm) for a, b in near.names)
