"""The everyday hand tasks, on NAOqi's effectors in the palms."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ik.tasks.axis_alignment import AHEAD, AxisAlignment
from pepper_kin.ik.tasks.frame_pose import FramePose
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.line_through_point import LineThroughPoint
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE
from pepper_kin.model.joint_vectors import check_choice

HAND_FRAMES = {"left": "LArm_effector", "right": "RArm_effector"}

# Where the line of `PointAt` begins, after the letter of the side: the elbow's and the shoulder's center.
LINE_STARTS = {"forearm": "ForeArm", "arm": "Bicep"}


def hand_frame(hand: str) -> str:
    """Return the effector frame of a hand.

    Raises:
        UnknownNameError: unless it is "left" or "right".
    """
    try:
        return HAND_FRAMES[hand]
    except (KeyError, TypeError):
        raise UnknownNameError("hand", hand, HAND_FRAMES) from None


class HandPosition(FramePosition):
    """The palm of a hand is at a point: `FramePosition` of `LArm_effector` or `RArm_effector`.

    Args:
        hand: "left" or "right".
        point: The point in the world [m], shape (3,).

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for a point of wrong shape, or with NaN or infinity.
    """

    def __init__(
        self,
        hand: str,
        point: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        super().__init__(hand_frame(hand), point, weight, tolerance, f"{hand} hand", hard=hard)


class HandPose(FramePose):
    """The palm of a hand has a position and an orientation: `FramePose` of its effector.

    An arm has five joints, so without the torso's help it meets a pose only by luck; then the position is met
    and the orientation comes as near as it can, and the result reports the two apart.

    Args:
        hand: "left" or "right".
        target: transform_hand_to_world, shape (4, 4).
        weight: Weight of the position.
        tolerance: Largest distance of a position that is met [m].
        orientation_weight: Weight of the orientation.
        orientation_tolerance: Largest angle of an orientation that is met [rad].
        hard: Whether the position is met even where soft tasks suffer from it.
        orientation_hard: The same of the orientation; as `hard` if None.
        position_first: Whether the position is preferred where not both can be met.

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for a target that is no pose.
    """

    def __init__(
        self,
        hand: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        orientation_weight: float = 1.0,
        orientation_tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
        orientation_hard: bool | None = None,
        position_first: bool = True,
    ) -> None:
        super().__init__(
            hand_frame(hand),
            target,
            weight,
            tolerance,
            orientation_weight,
            orientation_tolerance,
            f"{hand} hand",
            hard=hard,
            orientation_hard=orientation_hard,
            position_first=position_first,
        )


class PointAt(LineThroughPoint):
    """A hand points at a point, as people do with a stretched arm: the arm's line passes through it.

    The line is that of the forearm, from the elbow (`LForeArm`) through the middle of the hand (`l_hand`):
    the axis that the wrist turns about and that the open fingers follow, which is where an onlooker sees the
    arm point.  With `line="arm"` it begins in the shoulder (`LBicep`): shoulder, hand and point are on one
    line, however far the elbow is bent.  Either way the point lies beyond the hand, and the error is the
    angle between the line and the point as seen from the hand: at a distance d the line passes d sin(error)
    beside it.  Where the arm should only be parallel to a direction, use `Point`; with frames of your own, or
    for another robot, `LineThroughPoint`.

    Args:
        hand: "left" or "right".
        point: The point in the world [m], shape (3,), or (N, 3) for `solve_batch`.
        line: "forearm" or "arm".

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for another line, or a point of wrong shape, or with NaN or infinity.
    """

    def __init__(
        self,
        hand: str,
        point: ArrayLike,
        line: str = "forearm",
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        side = hand_frame(hand)[0]
        start = side + LINE_STARTS[check_choice("line", line, tuple(LINE_STARTS))]
        super().__init__(start, f"{side.lower()}_hand", point, weight, tolerance, f"{hand} {line}", hard=hard)


class Point(AxisAlignment):
    """The forearm and hand point along a direction: `AxisAlignment` of the x axis of the hand's effector.

    For a point to be pointed at there is `PointAt`.

    Args:
        hand: "left" or "right".
        direction: Direction in the world, shape (3,), of any length but zero.

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for a direction that is zero, of wrong shape, or with NaN or infinity.
    """

    def __init__(
        self,
        hand: str,
        direction: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        super().__init__(hand_frame(hand), direction, AHEAD, weight, tolerance, f"{hand} hand", hard=hard)
