"""Animations by keys and handles, in the form that Choregraphe edits and NAOqi plays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.exceptions import InvalidValueError, UnknownNameError, shortened
from pepper_kin.file_access.reading import repeated
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector
from pepper_kin.trajectory.enforce_limits import LimitViolation, enforce_limits, find_limit_violations
from pepper_kin.trajectory.key_curve import JointCurve, checked_parts, on_common_knots
from pepper_kin.trajectory.trajectory import Trajectory

HANDS = ("LHand", "RHand")
_CYCLE = 0.02  # cycle time of NAOqi [s]


@dataclass(frozen=True)
class Timeline:
    """An animation: curves of some joints.

    Attributes:
        name: Path of the animation in its file, such as "Box/Box/Timeline".
        curves: Curves, one for each moved joint.
    """

    name: str
    curves: tuple[JointCurve, ...]

    def __post_init__(self) -> None:
        """Check the curves.

        Raises:
            InvalidValueError: for two curves of one joint, no curve, or a duration of zero.
        """
        object.__setattr__(self, "curves", checked_parts(f"curves of {self.name}", self.curves, JointCurve))
        joints = [curve.joint for curve in self.curves]
        doubled = repeated(joints)
        if doubled or not joints:
            raise InvalidValueError(
                f"curves of {self.name}",
                shortened(", ".join(doubled)) or "none",
                "one or more joints, each once",
            )
        if self.duration <= 0:
            raise InvalidValueError(f"duration of {self.name}", "0 s", "a key after time 0")

    @property
    def duration(self) -> float:
        """Time of the last key [s]."""
        return max(curve.keys[-1].time for curve in self.curves)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that the animation moves."""
        return tuple(curve.joint for curve in self.curves)

    def to_trajectory(
        self, pepper: PepperModel, start: Array | None = None, *, ignore: str | Sequence[str] = HANDS
    ) -> Trajectory:
        """Return the unchanged animation, safe or not, as a trajectory.

        A joint whose first key is later than 0 moves there from its start with an automatic handle; it rests
        after its last key.  Joints without a curve rest at their start.  A jump at the last key adds 0.02 s.

        Args:
            pepper: The robot.
            start: Posture at time 0 [rad], shape (n,); the posture Stand, or neutral, if omitted.
            ignore: Joints of the animation to leave out if the robot lacks them; "foreign" for all joints
                that it lacks, such as NAO's legs.

        Returns:
            The motion of all joints of the robot, with its corners and jumps.

        Raises:
            UnknownNameError: for joints that the robot lacks and `ignore` does not name.
            InvalidValueError: for a start of the wrong shape, or if "foreign" leaves no joint.
        """
        rest = _start(pepper, start)
        curves = [curve for curve in self.curves if curve.joint in pepper.joint_names]
        foreign = [joint for joint in self.joint_names if joint not in pepper.joint_names]
        if ignore == "foreign":
            if not curves:
                raise InvalidValueError(f"joints of {self.name}", ", ".join(foreign), "one of the robot's")
        elif unknown := [joint for joint in foreign if joint not in ignore]:
            raise UnknownNameError(f"joint of {self.name}", ", ".join(unknown), pepper.joint_names)
        # A value reached by a jump at the end must be held for a while to be visible.
        jumps = any(len(c.keys) > 1 and c.keys[-2].behind.kind == "constant" for c in curves)
        duration = self.duration + (_CYCLE if jumps else 0.0)
        knots, coefficients = on_common_knots(pepper, curves, rest, duration)
        return Trajectory(pepper.joint_names, knots, coefficients, pepper.joint_units)


@dataclass(frozen=True, eq=False)
class ImportedMotion(BriefRepr):
    """An animation, and its motion within the robot's limits.

    Attributes:
        timeline: The animation.
        original: The unchanged motion of the animation.
        violations: Limit violations of the unchanged motion.
        trajectory: The motion that keeps the limits of position, velocity, acceleration, torque and balance.
    """

    timeline: Timeline
    original: Trajectory
    violations: tuple[LimitViolation, ...]
    trajectory: Trajectory

    def report(self, most: int = 20) -> str:
        """Return in words the durations of both motions and the violations, in order of time.

        Args:
            most: Maximum number of lines about violations.
        """
        head = (
            f"{self.timeline.name}: {len(self.timeline.curves)} joints, "
            f"{self.original.duration:.3f} s, now {self.trajectory.duration:.3f} s"
        )
        if not self.violations:
            return f"{head}; every limit of position, velocity and acceleration was kept"
        lines = [f"{head}; {len(self.violations)} times outside the limits:"]
        lines += [f"  {violation.sentence()}" for violation in self.violations[:most]]
        if len(self.violations) > most:
            lines.append(f"  ... and {len(self.violations) - most} more")
        return "\n".join(lines)


def import_timeline(
    pepper: PepperModel,
    timeline: Timeline,
    start: Array | None = None,
    *,
    ignore: str | Sequence[str] = HANDS,
    rounding: float = 0.02,
) -> ImportedMotion:
    """Return an animation with its limit violations and the motion that the robot can make.

    Args:
        pepper: The robot.
        timeline: The animation.
        start: Posture at time 0 [rad], shape (n,); the posture Stand, or neutral, if omitted.
        ignore: Joints of the animation to leave out if the robot lacks them; "foreign" for all joints that it
            lacks.
        rounding: Time between control points of the smoothed motion [s]; see `enforce_limits`.

    Raises:
        UnknownNameError: for joints that the robot lacks and `ignore` does not name.
        InvalidValueError: for a start of the wrong shape, a rounding out of range, or no joint of the robot.
        InfeasibleError: if the robot could not even hold a position on the way.
    """
    original = timeline.to_trajectory(pepper, start, ignore=ignore)
    safe = enforce_limits(pepper, original, rounding=rounding)
    return ImportedMotion(timeline, original, find_limit_violations(pepper, original), safe)


def _start(pepper: PepperModel, start: Array | None) -> Array:
    """Return the initial posture [rad or m], shape (n,); Stand, or neutral, if none is given."""
    if start is None:
        return pepper.posture("Stand") if "Stand" in pepper.posture_names else pepper.neutral()
    return as_joint_vector(pepper, start, "start")
