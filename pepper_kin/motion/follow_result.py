"""The result of following a path of tasks: a motion, or the reason."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.path import CubicPath


class FollowStatus(ResultStatus):
    """How following ended."""

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
        status: How it ended.
        message: What happened, in a sentence with place, joint and numbers.
        trajectory: The motion; None where there is none.
        curve: Joint positions over the path's parameter, before timing; None where there are none.
        tasks: Names of the tasks.
        errors: Greatest error of each task along the curve [m or rad], shape (tasks,), recomputed.
        relaxed: Names of tasks that were given up for those before them: they are met as well as can be.
        slowest: Least speed, as a share of the one asked for, between the places where it is first and last
            reached on a stretch from rest to rest; 1.0 where none was asked for, or a stretch is too short.
        reached: How much of the way can be followed, 0 to 1; all of it at less speed where that is too fast.
        aside: Joints that no task moves and that go out of the way, such as "HeadYaw by 0.12 rad".
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
        """What to try, in a sentence."""
        return self.status.advice

    def report(self) -> str:
        """Return the result in plain words."""
        lines = [self.message]
        for name, error in zip(self.tasks, self.errors, strict=True):
            lines.append(f"{name}: at most {error:.2g} off" + (" (relaxed)" if name in self.relaxed else ""))
        return "\n".join([*lines, self.advice])


def words_for_aside(aside: Iterable[str]) -> str:
    """Return a sentence on `Followed.aside`, after a blank; empty where all joints rest."""
    named = ", ".join(aside)
    return f" No task moves {named}: out of the way." if named else ""


class NotFollowedError(Exception):
    """Why a path is not followed.

    Attributes:
        status: How it ended.
        message: Why, in a sentence.
        reached: Where on the way that is, 0 to 1.
        postures: Postures at nodes up to there, shape (k, n); None without.
        joint: The joint that is too fast; None without.
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
        """The result that says so."""
        reached = 1.0 if self.status is FollowStatus.TOO_FAST else self.reached
        return Followed(self.status, self.message, reached=reached)
