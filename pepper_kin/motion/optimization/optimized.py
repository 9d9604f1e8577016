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
    """How the optimization of a motion ended; `advice` says what to try."""

    IMPROVED = "improved", "Examine it with check()."
    NOT_CHEAPER = "not_cheaper", "Take the motion as it is, or weigh jerk more."
    NOT_CLEAR = "not_clear", "Give a path that keeps more distance, more intervals or a smaller margin."
    OFF_CONSTRAINT = "off_constraint", "Give a path that keeps the tasks, as plan() does, or more intervals."
    NO_ROOM = "no_room", "Give a path further from limits, more intervals, or a longer duration."


@dataclass(frozen=True, eq=False)
class Optimized(BriefRepr):
    """The outcome of `optimize`.

    Attributes:
        status: How it ended.
        message: What happened, in a sentence with numbers.
        trajectory: The optimized motion where it was improved, else the one before.
        before: The motion that was given, made slower where it broke the limits asked for; where a path was
            given, along it in the shortest time.
        figures: Duration, jerk and effort of `trajectory`.
        figures_before: The same of `before`.
        cost: The weights.
        evidence: What gives `clearance`, or its value.
        descent: How the search itself ended; None where it had no start.
        time: Wall time [s], the timing of a given path included, the compiling of code not.
        constraint_errors: Largest error of each task that was to stay met, along `trajectory`, by Pinocchio,
            groups taken apart [m or rad]; empty where there are none.
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
        """Least distances of `trajectory` to obstacles and between parts of the robot [m], by coal.

        Of every millisecond, measured when first asked for; by how much bodies may come nearer in between is
        the `resolution` that `check` states.
        """
        return self.evidence() if callable(self.evidence) else self.evidence

    def __getstate__(self) -> dict[str, Any]:
        """Travel with the clearance instead of the means to measure it."""
        return {**self.__dict__, "clearance": self.clearance, "evidence": self.clearance}

    @property
    def success(self) -> bool:
        """Whether the motion was improved."""
        return self.status is OptimizedStatus.IMPROVED

    @property
    def shorter_by(self) -> float:
        """Share of the duration that was saved; negative where the motion became longer."""
        return 1.0 - self.figures.duration / self.figures_before.duration

    @property
    def smoother_by(self) -> float:
        """Share of the jerk that was saved."""
        return 1.0 - self.figures.jerk / self.figures_before.jerk

    def report(self) -> str:
        """Say in plain words what was gained, and what to try."""
        return f"{self.message} {self.status.advice}"
