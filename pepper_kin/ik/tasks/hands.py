"""Tasks of Pepper's hands, on NAOqi's effector frames in the palms."""

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

# Frame where the line of `PointAt` begins, without the side's letter: the elbow's or shoulder's center.
LINE_STARTS = {"forearm": "ForeArm", "arm": "Bicep"}


def hand_frame(hand: str) -> str:
    """Return the name of a hand's effector frame.

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
        point: Point in the world [m], shape (3,).

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

    An arm has five joints, so without the torso it rarely meets a pose; otherwise the position is met, the
    orientation comes as near as it can, and the result reports both separately.

    Args:
        hand: "left" or "right".
        target: transform_hand_to_world, shape (4, 4).
        weight: Weight of the position.
        tolerance: Maximum error of a position that is met [m].
        orientation_weight: Weight of the orientation.
        orientation_tolerance: Maximum error of an orientation that is met [rad].
        hard: Whether the position has priority over soft tasks.
        orientation_hard: Whether the orientation has priority over soft tasks; `hard` if None.
        position_first: Whether the position has priority over the orientation.

    Raises:
        UnknownNameError: for another hand.
        InvalidValueError: for a target that is not a pose.
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
    """A hand points at a point like a person with a stretched arm: the arm's line passes through the point.

    The line of the forearm begins at the elbow (`LForeArm`) and passes through the middle of the hand
    (`l_hand`): the wrist's axis, along which the open fingers point, so that an onlooker sees the arm point
    there. With `line="arm"` it begins at the shoulder (`LBicep`): shoulder, hand and point are on one line
    for any bending of the elbow. In both cases the point lies beyond the hand, and the error is the angle
    between the line and the point seen from the hand: at a distance d the line passes d sin(error) beside the
    point. For an arm parallel to a direction use `Point`; for other frames or robots `LineThroughPoint`.

    Args:
        hand: "left" or "right".
        point: Point in the world [m], shape (3,), or (N, 3) for `solve_batch`.
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

    To point at a point, use `PointAt`.

    Args:
        hand: "left" or "right".
        direction: Direction in the world, shape (3,), not zero; it is normalized.

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
