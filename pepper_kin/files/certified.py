"""Certificates of motions in files, computed for the curves that readers interpolate."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

from pepper_kin.exceptions import CallError, InvalidValueError
from pepper_kin.files.motion_points import (
    MotionPoints,
    points_at,
    points_every,
    points_near,
    slowing_needed,
)
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.joint_vectors import shown
from pepper_kin.trajectory.certificate import Certificate
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.trajectory import Trajectory, checked_trajectory

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.limits import JerkLike

SLOWED = 1e-4
"""Maximum relative slowing of a motion that uses a limit fully when it is written."""

_LEVELS = ((1e-2, 0.0), (1e-3, 1e-5), (1e-4, 1e-5), (1e-5, SLOWED))
"""Levels tried in turn: maximum error of acceleration relative to the limits, and minimum relative
slowing."""

_LEAST_DT = 1e-3  # minimum dt tried after a refused one, and step of the values tried [s]


class Conditions(TypedDict, total=False):
    """Options of `pepper_kin.trajectory.check`, which describes them."""

    scene: Scene | None
    collisions: bool
    jerk: JerkLike | None
    balance: float | None
    hand_speed: float | Mapping[str, float] | None
    payload: Mapping[str, float] | None


class Examination(NamedTuple):
    """Robot and conditions of a motion's check.

    Attributes:
        pepper: The robot.
        conditions: Options of `pepper_kin.trajectory.check`, such as the scene.
    """

    pepper: PepperModel
    conditions: Conditions

    def certificate(self, trajectory: Trajectory) -> Certificate:
        """Return the certificate of `pepper_kin.trajectory.check`.

        Raises:
            InvalidValueError: for a subclass of `Trajectory`, whose motion may differ from the checked one.
        """
        if type(trajectory) is not Trajectory:
            raise InvalidValueError("trajectory", f"a {type(trajectory).__name__}", "a Trajectory itself")
        return check(self.pepper, trajectory, **self.conditions)

    def passes(self, curve: Trajectory) -> bool:
        """Return whether a curve passes; the full check is skipped if a limit is exceeded at some states."""
        return slowing_needed(self.pepper, curve).max() <= 1.0 + 1e-8 and self.certificate(curve).success

    def refuse(self, trajectory: Trajectory, advice: str) -> None:
        """Refuse a trajectory that fails its own certificate.

        Raises:
            InvalidValueError: with the failed checks and their amounts.
        """
        certificate = self.certificate(trajectory)
        if not certificate.success:
            raise InvalidValueError(
                "trajectory",
                f"one that fails {', '.join(certificate.failures)}",
                f"one that passes check(){advice}; {_first(certificate)}",
            )


def examination(
    trajectory: Trajectory,
    pepper: PepperModel | None,
    unchecked: bool,
    conditions: Conditions,
    *,
    needed: bool = True,
) -> Examination | None:
    """Return the robot and conditions of a motion's check; None for no check.

    Args:
        trajectory: The motion.
        pepper: The robot that is to play the motion; None for the Pepper whose joints have the motion's
            names.
        unchecked: Whether to skip the check.
        conditions: Options of `pepper_kin.trajectory.check`.
        needed: Whether an unknown robot is an error; otherwise the check is skipped.

    Raises:
        InvalidValueError: for joints of an unknown robot, or an `unchecked` that is neither True nor False.
        CallError: for an unknown option.
    """
    checked_trajectory(trajectory)
    if not isinstance(unchecked, bool):
        raise InvalidValueError("unchecked", shown(unchecked), "True or False")
    if unknown := set(conditions) - set(Conditions.__annotations__):
        raise CallError(f"no argument {min(unknown)!r}", min(unknown), Conditions.__annotations__)
    if unchecked:
        return None
    robot = pepper_with_joints(trajectory.joint_names) if pepper is None else pepper
    if robot is None and needed:
        raise InvalidValueError(
            "pepper", None, "the robot that is to play the motion, which is checked, or unchecked=True"
        )
    return None if robot is None else Examination(robot, conditions)


def certified_points(
    trajectory: Trajectory, step: float, dt: float | None, examined: Examination | None, bezier: bool = False
) -> MotionPoints:
    """Return points of a trajectory whose interpolated curve passes its certificate.

    Args:
        trajectory: The trajectory.
        step: Time between points that is tried first without dt [s].
        dt: Time between points [s]; None to choose points that pass: every `step` if that passes, else at the
            motion's jumps of acceleration and as dense as needed. A motion that uses a limit fully is then
            slowed by at most `SLOWED`.
        examined: Robot and conditions of the check; None for no check.
        bezier: Whether NAOqi interpolates.

    Raises:
        InvalidValueError: for a dt that is not above zero; for a trajectory that fails its certificate; or
            for one whose curve fails, with the failed checks, time and the largest dt that passes.
    """
    points = points_every(trajectory, step if dt is None else dt, bezier)
    if examined is None or examined.passes(curve := points.curve()):
        return points
    if dt is not None:
        examined.refuse(trajectory, ", or unchecked=True")
        failed = examined.certificate(curve)
        raise InvalidValueError(
            "dt",
            f"{dt:g} s, whose curve fails {', '.join(failed.failures)}",
            f"{_largest_dt(trajectory, dt, examined, bezier)}, None for points that are chosen to pass, or "
            f"unchecked=True; {_first(failed)}",
        )
    for tolerance, slower in _LEVELS:
        time, quintic = points_near(examined.pepper, trajectory, step, tolerance, bezier)
        points = points_at(trajectory, time, quintic=quintic, from_rest=bezier)
        needed = float(slowing_needed(examined.pepper, points.curve()).max()) - 1.0
        slower = max(slower, needed + 2e-6 if needed > 0.0 else 0.0)
        if slower > SLOWED:
            continue
        if slower > 0.0:
            points = points_at(trajectory, time, quintic=quintic, from_rest=bezier, stretch=1.0 + slower)
        if examined.passes(points.curve()):
            return points
    examined.refuse(trajectory, ", or unchecked=True")
    failed = examined.certificate(points.curve())
    raise InvalidValueError(
        "trajectory",
        f"one of which no curve through points was found that passes {', '.join(failed.failures)}",
        f"one with more distance to its limits, or unchecked=True; {_first(failed)}",
    )


def _first(certificate: Certificate) -> str:
    """Return the sentence of the first failed check."""
    return certificate.checks[certificate.failures[0]].sentence()


def _largest_dt(trajectory: Trajectory, dt: float, examined: Examination, bezier: bool) -> str:
    """Return the largest passing dt in whole milliseconds below a given one, in words, by bisection."""

    def passes(count: int) -> bool:
        return examined.passes(points_every(trajectory, count * _LEAST_DT, bezier).curve())

    fails = int(min(dt, trajectory.duration) / _LEAST_DT) + 1
    good = fails // 2
    while good and not passes(good):
        fails, good = good, good // 2
    if not good:
        return "a motion with more distance to its limits, as no dt was found that passes"
    while fails - good > max(1, good // 16):
        middle = (good + fails) // 2
        good, fails = (middle, fails) if passes(middle) else (good, middle)
    return f"{good * _LEAST_DT:g} s, the largest found that passes"


def refuse_unsafe(
    trajectory: Trajectory,
    pepper: PepperModel | None,
    scene: Any | None,
    payload: Mapping[str, float] | None,
    unchecked: bool,
    *,
    advice: str = ", or unchecked=True",
) -> None:
    """Refuse a motion that fails its certificate.

    Args:
        trajectory: The motion.
        pepper: The robot that is to play the motion; None for the Pepper whose joints have the motion's
            names.
        scene: The `pepper_kin.collision.Scene` around it; None for the robot against itself only.
        payload: Point masses at "left", "right" or a frame by name [kg].
        unchecked: Whether to skip the check.
        advice: Alternatives of the caller, for the message.

    Raises:
        InvalidValueError: with the failed checks and their amounts; for joints of an unknown robot; or for an
            `unchecked` that is neither True nor False.
    """
    examined = examination(trajectory, pepper, unchecked, {"scene": scene, "payload": payload})
    if examined is not None:
        examined.refuse(trajectory, advice)


def pepper_with_joints(names: tuple[str, ...]) -> PepperModel | None:
    """Return the Pepper whose joints have the names in the given order; None if there is none."""
    for base, hands in itertools.product(("fixed", "planar"), ("locked", "mimic", "independent")):
        try:
            robot = load_pepper(base=base, hands=hands)
        except InvalidValueError:
            continue
        if robot.joint_names == names:
            return robot
    return None
