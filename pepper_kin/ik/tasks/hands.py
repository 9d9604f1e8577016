"""The everyday hand tasks, on NAOqi's effectors in the palms."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ik.tasks.axis_alignment import AHEAD, AxisAlignment
from pepper_kin.ik.tasks.frame_pose import FramePose
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE

HAND_FRAMES = {"left": "LArm_effector", "right": "RArm_effector"}


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
        weight: Weight in the sum of squares.
        tolerance: Largest distance of a task that is met [m].
        hard: Whether it is met even where soft tasks suffer from it.

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
        position_first: Whether the orientation gives way where not both can be met.

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


class Point(AxisAlignment):
    """The forearm and hand point along a direction: `AxisAlignment` of the x axis of the hand's effector.

    Args:
        hand: "left" or "right".
        direction: Direction in the world, shape (3,), of any length but zero.
        weight: Weight in the sum of squares.
        tolerance: Largest angle of a task that is met [rad].
        hard: Whether it is met even where soft tasks suffer from it.

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
