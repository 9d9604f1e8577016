"""Results of a base-placement search."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.base_placement.placement_map import PlacementMap, map_of
from pepper_kin.base_placement.score import PlacementTerms
from pepper_kin.ik.result import CONFLICT_ADVICE, NOT_EXAMINED, IKResult, listed
from pepper_kin.ik.tasks.task import words_for, words_for_angle, words_for_length
from pepper_kin.status import ResultStatus


class PlacementStatus(ResultStatus):
    """How the search for a place ended."""

    FOUND = "found", "Drive to the first placement and use its q."
    NOT_TOGETHER = (
        "not_together",
        "Each target is reached from somewhere, but no place was found for all: serve them from "
        "several places, bring them closer together, let more joints move, or try more candidates.",
    )
    UNREACHABLE = (
        "unreachable",
        "The named targets are not reached from any place: change their height or direction, let more "
        "joints move, or ask for less (a position without an orientation, a wider tolerance).",
    )
    BLOCKED_BY_COLLISION = (
        "blocked_by_collision",
        "All targets are reached, but only in collision: move the obstacle or the targets, or try "
        "more candidates.",
    )


@dataclass(frozen=True, eq=False)
class Placement(BriefRepr):
    """One base pose with its solutions.

    Attributes:
        x: Position of the base on the floor [m].
        y: Position of the base on the floor [m].
        yaw: Heading, from the world's x axis to the left [rad], -pi to pi.
        score: Between 0 and 1, see `PlacementWeights`; 0 where a target is not reached.
        terms: The quantities behind the score.
        q: Joint positions for each set of tasks, shape (T, n) [rad or m], read-only.
        results: The inverse kinematics of each set, in the world's coordinates, with certificate and report;
            for a robot with a fixed base their q begins with the place, `BaseX`, `BaseY`, `BaseYaw`.
    """

    x: float
    y: float
    yaw: float
    score: float
    terms: PlacementTerms
    q: Array
    results: tuple[IKResult, ...] = field(repr=False)

    @property
    def success(self) -> bool:
        """Whether every target is reached and nothing touches, where collisions are examined."""
        return all(result.success and not result.in_collision for result in self.results)

    @property
    def transform_base_to_world(self) -> Array:
        """The pose of the base, shape (4, 4): maps coordinates of the robot's floor frame to the world's."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        pose = np.eye(4)
        pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
        pose[:2, 3] = self.x, self.y
        return pose

    def words(self) -> str:
        """Return the place in words."""
        return f"({self.x + 0.0:.2f}, {self.y + 0.0:.2f}) m facing {math.degrees(self.yaw) + 0.0:.0f} deg"


@dataclass(frozen=True, eq=False)
class PlacementResult(BriefRepr):
    """Base poses, the best first.

    Attributes:
        status: How the search ended.
        placements: Ranked; where the status is not FOUND, the places that come nearest to serving.
        unreached: Numbers of the sets (from 0) that no place reaches.
        places: All places that were tried: x, y [m], yaw [rad], shape (N, 3); the first is the current place.
        scores: Their scores, without clearance, shape (N,); 0 where a target is not reached.
        reached: Whether each set is reached from each place, shape (N, T).
        touching: Whether something touches there, shape (N,); looked at where all sets are reached
            and collisions are examined.
        names: What each set moves, in words.
        time: Wall-clock time of the call [s].
        seed: Of the search.
        conflicts: For each of `unreached` the names of its tasks that contradict each other; none where it is
            just too far.
    """

    status: PlacementStatus
    placements: tuple[Placement, ...]
    unreached: tuple[int, ...]
    places: Array
    scores: Array
    reached: np.ndarray
    touching: np.ndarray
    names: tuple[str, ...]
    time: float
    seed: int
    conflicts: tuple[tuple[str, ...], ...]

    @property
    def success(self) -> bool:
        """Whether a place was found from which every target is reached."""
        return self.status is PlacementStatus.FOUND

    @property
    def best(self) -> Placement:
        """The first placement."""
        return self.placements[0]

    @property
    def here(self) -> bool:
        """Whether the current place is suitable already."""
        return bool(self.reached[0].all() and not self.touching[0])

    @property
    def advice(self) -> str:
        """What to do next, in a sentence; or in two, where some tasks contradict each other, not all."""
        if self.status is not PlacementStatus.UNREACHABLE or not any(self.conflicts):
            return self.status.advice
        return CONFLICT_ADVICE if all(self.conflicts) else f"{self.status.advice}  {CONFLICT_ADVICE}"

    def score_map(self, resolution: float = 0.1) -> PlacementMap:
        """Return the best score of the places that were tried, by cells of the floor; see `placement_map`.

        Raises:
            InvalidValueError: for a resolution that is not above 0.
        """
        good = self.reached.all(axis=1) & ~self.touching
        return map_of(self.places, np.where(good, self.scores, np.nan), resolution)

    def report(self) -> str:
        """Return the result in plain words, one fact a line."""
        lines = [self._headline(), *self._targets(), self._score()]
        count = int(self.reached[0].sum())
        serves = "serves too" if self.here else f"reaches {count} of {len(self.names)}"
        if self.reached[0].all() and self.touching[0]:
            serves += ", but in collision"
        lines.append(f"the current place {serves}")
        others = self.placements[1:] if self.success else ()
        if others:
            listed = "; ".join(f"{place.words()}, score {place.score:.2f}" for place in others)
            lines.append(f"other places: {listed}")
        every = self.reached.all(axis=1)
        touching = f", {int(self.touching.sum())} of them in collision" if self.touching.any() else ""
        lines.append(
            f"{len(self.places)} places tried, {int(every.sum())} reach every target{touching}; "
            f"{self.time:.2f} s (seed {self.seed})"
        )
        if self.best.results[0].in_collision is None:
            lines.append(NOT_EXAMINED)
        if not self.success:
            lines.append(self.advice)
        return "\n".join(lines)

    def _headline(self) -> str:
        best = self.best
        if self.success:
            way = (
                f"{words_for_length(best.terms.distance)} away, a turn of {words_for_angle(best.terms.turn)}"
            )
            return f"found: stand at {best.words()}; {way}"
        reached = sum(result.success for result in best.results)
        start = {
            PlacementStatus.NOT_TOGETHER: "not found: no place reaches all targets",
            PlacementStatus.UNREACHABLE: f"not found: {self._unreached()}",
            PlacementStatus.BLOCKED_BY_COLLISION: "not found: every place that reaches all is in collision",
        }[self.status]
        return f"{start}; nearest is {best.words()}, which reaches {reached} of {len(self.names)}"

    def _unreached(self) -> str:
        """Say of all sets that no place reaches whether they are too far or contradictory."""
        sets = [
            (f"target {k + 1}", self.names[k], conflict)
            for k, conflict in zip(self.unreached, self.conflicts, strict=True)
        ]
        far = [f"{target} ({name})" for target, name, conflict in sets if not conflict]
        parts = [f"{', '.join(far)} out of reach from every place"] if far else []
        parts += [
            f"of {target}, {listed(conflict)} contradict each other, wherever the base stands"
            for target, _, conflict in sets
            if conflict
        ]
        return "; ".join(parts)

    def _targets(self) -> list[str]:
        lines = []
        for k, result in enumerate(self.best.results):
            facts = "; ".join(
                f"{error.label}: error {words_for(error.value, error.unit)}" if error.met else error.shortfall
                for error in result.errors
            )
            lines.append(f"target {k + 1}: {facts}")
        return lines

    def _score(self) -> str:
        terms, parts = self.best.terms, []
        if terms.limit_margin is not None:
            parts.append(f"{100 * terms.limit_margin:.0f} % of {terms.tightest_joint}'s range to its limit")
        if terms.manipulability is not None:
            parts.append(f"{100 * terms.manipulability:.0f} % of the largest manipulability")
        if terms.clearance is not None:
            parts.append(f"{1000 * terms.clearance:.1f} mm from obstacles")
        parts.append(f"{terms.distance:.2f} m and {math.degrees(terms.turn):.0f} deg to go")
        return f"score {self.best.score:.2f}: {', '.join(parts)}"
