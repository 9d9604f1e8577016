"""Certificates of motions before they go into files that robots play."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, load_pepper
from pepper_kin.model.joint_vectors import shown
from pepper_kin.trajectory.certificate import Certificate
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.trajectory import Trajectory


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
        pepper: The robot that is to play it; None for Pepper with joints of these names.
        scene: The `pepper_kin.collision.Scene` around it; None for the robot against itself only.
        payload: Point masses held, as `pepper_kin.trajectory.check` takes them.
        unchecked: Whether to let anything pass.
        advice: What else the caller may do, for the message.

    Raises:
        InvalidValueError: with what fails, and by how much; for joints of no robot that is known; or for an
            `unchecked` that is neither True nor False.
    """
    if not isinstance(unchecked, bool):
        raise InvalidValueError("unchecked", shown(unchecked), "True or False")
    if unchecked:
        return
    robot = pepper_with_joints(trajectory.joint_names) if pepper is None else pepper
    if robot is None:
        raise InvalidValueError(
            "pepper", None, "the robot that is to play the motion, which is checked, or unchecked=True"
        )
    certificate = _examined(trajectory, robot, scene, payload)
    if not certificate.success:
        first = certificate.checks[certificate.failures[0]].sentence()
        raise InvalidValueError(
            "trajectory",
            f"one that fails {', '.join(certificate.failures)}",
            f"one that passes check(){advice}; {first}",
        )


def _examined(
    trajectory: Trajectory, robot: PepperModel, scene: Any | None, payload: Mapping[str, float] | None
) -> Certificate:
    """Return the certificate of a motion by the library's own function.

    Raises:
        InvalidValueError: for a subclass, which may play another motion than the one examined.
    """
    if type(trajectory) is not Trajectory:
        raise InvalidValueError("trajectory", f"a {type(trajectory).__name__}", "a Trajectory itself")
    return check(robot, trajectory, scene=scene, payload=payload)


def pepper_with_joints(names: tuple[str, ...]) -> PepperModel | None:
    """Return the Pepper that has joints of these names in this order; None if there is none."""
    for base, hands in itertools.product(("fixed", "planar"), ("locked", "mimic", "independent")):
        try:
            robot = load_pepper(base=base, hands=hands)
        except InvalidValueError:
            continue
        if robot.joint_names == names:
            return robot
    return None
