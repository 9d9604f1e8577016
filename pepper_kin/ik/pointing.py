"""Pointing with a stretched arm."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pepper_kin.ik.tasks.hands import PointAt, hand_frame
from pepper_kin.ik.tasks.joint_value import JointValue
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE

STRAIGHT_ELBOW = 0.02
"""Angle of an elbow that counts as straight [rad]: its limit is 0.0087."""


def straight_pointing(
    hand: str, point: ArrayLike, tolerance: float = ANGLE_TOLERANCE
) -> tuple[PointAt, JointValue]:
    """Return the tasks of pointing with a stretched arm: `PointAt` of the forearm, and a straight elbow.

        pk.ik.solve(pepper, [pk.ik.LookAt(point), *pk.ik.straight_pointing("right", point)])

    `ElbowRoll` is near its limit.  The 10 degrees between upper arm and forearm that are left are built in:
    the forearm begins 1.5 cm beside the upper arm, and 9 degrees are fixed between both.

    Args:
        hand: "left" or "right".
        point: The point in the world [m], shape (3,), or (N, 3) for `solve_batch`.
        tolerance: Of the forearm's line [rad].

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for a point of wrong shape, or with NaN or infinity, or a tolerance that is none.
    """
    side = hand_frame(hand)[0]
    bent = {"L": -STRAIGHT_ELBOW, "R": STRAIGHT_ELBOW}[side]
    return PointAt(hand, point, tolerance=tolerance), JointValue(f"{side}ElbowRoll", bent, weight=0.3)
