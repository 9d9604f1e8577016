"""Pointing with a stretched arm."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pepper_kin.ik.tasks.hands import PointAt, hand_frame
from pepper_kin.ik.tasks.joint_value import JointValue
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE

STRAIGHT_ELBOW = 0.02
"""Magnitude of ElbowRoll of a straight elbow [rad]: its limit is 0.0087."""


def straight_pointing(
    hand: str, point: ArrayLike, tolerance: float = ANGLE_TOLERANCE
) -> tuple[PointAt, JointValue]:
    """Return the tasks of pointing with a stretched arm: `PointAt` of the forearm and a straight elbow.

        pk.ik.solve(pepper, [pk.ik.LookAt(point), *pk.ik.straight_pointing("right", point)])

    `ElbowRoll` is near its limit. The remaining 10 degrees between upper arm and forearm are mechanical: the
    forearm begins 1.5 cm beside the upper arm, at a fixed angle of 9 degrees.

    Args:
        hand: "left" or "right".
        point: Point in the world [m], shape (3,), or (N, 3) for `solve_batch`.
        tolerance: Tolerance of the forearm's line [rad].

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for a point of wrong shape, or with NaN or infinity, or an invalid tolerance.
    """
    side = hand_frame(hand)[0]
    bent = {"L": -STRAIGHT_ELBOW, "R": STRAIGHT_ELBOW}[side]
    return PointAt(hand, point, tolerance=tolerance), JointValue(f"{side}ElbowRoll", bent, weight=0.3)
