"""Result of a trajectory optimization."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pepper_kin.arrays import BriefRepr
from pepper_kin.collision import Clearance
from pepper_kin.motion.optimization.cost import Cost, Figures
from pepper_kin.planners.optimization import LocalResult
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory


class OptimizedStatus(ResultStatus):
    """Status of the optimization; `advice` says what to try."""

    IMPROVED = "improved", "Examine it with check()."
    NOT_CHEAPER = "not_cheaper", "Take the motion as it is, or weigh jerk more."
    NOT_CLEAR = "not_clear", "Give a path that keeps more distance, more intervals or a smaller margin."
    OFF_CONSTRAINT = "off_constraint", "Give a path that keeps the tasks, as plan() does, or more intervals."
    NO_ROOM = "no_room", "Give a path further from limits, more intervals, or a longer duration."


@dataclass(frozen=True, eq=False)
class Optimized(BriefRepr):
    """Result of `optimize`.

    Attributes:
        status: Status of the optimization.
        message: What happened, in a sentence with numbers.
        trajectory: The optimized motion if it is an improvement, else the motion before.
        before: The given motion, slowed down if it violated limits; for a path, the time-optimal motion along
            it.
        figures: Duration, jerk and effort of `trajectory`.
        figures_before: Duration, jerk and effort of `before`.
        cost: Weights of the cost.
        evidence: Function that computes `clearance`, or its value.
        descent: Result of the search itself; None if it had no start.
        time: Wall time [s], including the timing of a given path, without compiling code.
        constraint_errors: Largest error of each constraint task along `trajectory`, by Pinocchio, with groups
            split [m or rad]; empty without constraints.
    """

    status: OptimizedStatus
    message: str
    trajectory: Trajectory
    before: Trajectory
    figures: Figures
    figures_before: Figures
    cost: Cost
    evidence: Callable[[], Clearance] | Clearance
    descent: LocalResult | None
    time: float
    constraint_errors: tuple[float, ...] = ()

    @cached_property
    def clearance(self) -> Clearance:
        """Minimum distances of `trajectory` to obstacles and between parts of the robot [m], by coal.

        They are measured every millisecond, at their first use; the `resolution` of `check` bounds how much
        nearer bodies may come in between.
        """
        return self.evidence() if callable(self.evidence) else self.evidence

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickling, with the clearance computed."""
        return {**self.__dict__, "clearance": self.clearance, "evidence": self.clearance}

    @property
    def success(self) -> bool:
        """Whether the motion was improved."""
        return self.status is OptimizedStatus.IMPROVED

    @property
    def shorter_by(self) -> float:
        """Fraction of the duration that was saved; negative if the motion became longer."""
        return 1.0 - self.figures.duration / self.figures_before.duration

    @property
    def smoother_by(self) -> float:
        """Fraction of the jerk that was saved."""
        return 1.0 - self.figures.jerk / self.figures_before.jerk

    def report(self) -> str:
        """Return in plain words the gain, and what to try."""
        return f"{self.message} {self.status.advice}"
