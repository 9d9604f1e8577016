"""Result of following a path of tasks: a motion, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.path import CubicPath


class FollowStatus(ResultStatus):
    """Status of following a path of tasks."""

    DONE = "done", "Execute `trajectory`."
    START_INVALID = "start_invalid", "Start from a posture of `ik.solve` with the tasks at 0, or from None."
    OUT_OF_REACH = "out_of_reach", "Move the path, let more joints move, or move the base."
    BLOCKED_BY_LIMITS = "blocked_by_limits", "Start from another posture or from None, or move the path."
    JUMP = "jump", "Start from another posture or from None: from this one the arm would have to turn over."
    IN_COLLISION = "in_collision", "Move the path or the obstacle, or start from another posture."
    NOT_HELD = "not_held", "Keep the hand nearer to the body, or carry less."
    TOO_FAST = "too_fast", "Ask for the speed in the message, or for None: as fast as limits allow."


@dataclass(frozen=True, eq=False)
class Followed(BriefRepr):
    """A motion along a path of tasks, or why there is none.

    Attributes:
        status: Status of the result.
        message: What happened, in a sentence with place, joint and numbers.
        trajectory: The motion; None if there is none.
        curve: Joint positions over the path's parameter, before timing; None if there are none.
        tasks: Names of the tasks.
        errors: Largest error of each task along the curve [m or rad], shape (tasks,), recomputed.
        relaxed: Names of tasks that were relaxed in favor of tasks before them; they are met as closely as
            possible.
        slowest: Minimum speed, relative to the requested one, between the points where that speed is first
            and last reached on each segment from rest to rest; 1.0 if no speed was requested, or a segment is
            too short.
        reached: Fraction of the path that can be followed, 0 to 1; 1 for TOO_FAST, where a lower speed
            suffices.
        aside: Joints that no task moves but that move to avoid collisions, such as "HeadYaw by 0.12 rad".
        time: Wall time [s].
    """

    status: FollowStatus
    message: str
    trajectory: Trajectory | None = None
    curve: CubicPath | None = field(default=None, repr=False)
    tasks: tuple[str, ...] = ()
    errors: Array = field(default_factory=lambda: np.zeros(0))
    relaxed: tuple[str, ...] = ()
    slowest: float = 1.0
    reached: float = 0.0
    time: float = 0.0
    aside: tuple[str, ...] = ()

    @property
    def success(self) -> bool:
        """Whether there is a motion along the whole path."""
        return self.status is FollowStatus.DONE

    @property
    def advice(self) -> str:
        """Advice on what to try, as a sentence."""
        return self.status.advice

    def report(self) -> str:
        """Return the result in plain words."""
        lines = [self.message]
        for name, error in zip(self.tasks, self.errors, strict=True):
            lines.append(f"{name}: at most {error:.2g} off" + (" (relaxed)" if name in self.relaxed else ""))
        return "\n".join([*lines, self.advice])


def words_for_aside(aside: Iterable[str]) -> str:
    """Return a sentence on `Followed.aside` with a leading blank; empty if there are no such joints."""
    named = ", ".join(aside)
    return f" No task moves {named}: out of the way." if named else ""


class NotFollowedError(Exception):
    """The reason why a path cannot be followed.

    Attributes:
        status: Status of the result.
        message: The reason, in a sentence.
        reached: Fraction of the path before the failure, 0 to 1.
        postures: Joint positions at nodes up to the failure [rad or m], shape (k, n); None if unknown.
        joint: Index of the joint that is too fast; None for other reasons.
    """

    def __init__(
        self, status: FollowStatus, message: str, reached: float = 0.0, *, postures: Array | None = None,
        joint: int | None = None,
    ) -> None:  # fmt: skip
        super().__init__(message)
        self.status, self.message, self.reached = status, message, reached
        self.postures, self.joint = postures, joint

    @property
    def result(self) -> Followed:
        """The result with this status and reason."""
        reached = 1.0 if self.status is FollowStatus.TOO_FAST else self.reached
        return Followed(self.status, self.message, reached=reached)
