"""Result of a base-placement search."""

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
        score: Score from 0 to 1, see `PlacementWeights`; 0 if a target is not reached.
        terms: Terms of the score.
        q: Joint positions for each set of tasks, shape (T, n) [rad or m], read-only.
        results: Inverse kinematics of each set in world coordinates, with certificate and report; for a robot
            with a fixed base their q begins with the base pose, `BaseX`, `BaseY`, `BaseYaw`.
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
        """Whether every target is reached without collision, if collisions are checked."""
        return all(result.success and not result.in_collision for result in self.results)

    @property
    def transform_base_to_world(self) -> Array:
        """Pose of the base, shape (4, 4) [m]: maps coordinates of the robot's floor frame to the world's."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        pose = np.eye(4)
        pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
        pose[:2, 3] = self.x, self.y
        return pose

    def words(self) -> str:
        """Return the base pose in words."""
        return f"({self.x + 0.0:.2f}, {self.y + 0.0:.2f}) m facing {math.degrees(self.yaw) + 0.0:.0f} deg"


@dataclass(frozen=True, eq=False)
class PlacementResult(BriefRepr):
    """Base poses, the best first.

    Attributes:
        status: Status of the search.
        placements: Placements, the best first; if the status is not FOUND, the nearest base poses.
        unreached: Indices of the sets that no base pose reaches.
        places: All base poses tried: x, y [m], yaw [rad], shape (N, 3); the first is the current one.
        scores: Scores of the tried base poses, without clearance, shape (N,); 0 if a target is not reached.
        reached: Whether each set is reached from each base pose, shape (N, T).
        touching: Whether the robot is in collision at each base pose, shape (N,); checked if all sets are
            reached and collisions are checked.
        names: Moved parts of each set, in words.
        time: Wall-clock time of the call [s].
        seed: Seed of the search.
        conflicts: Names of the tasks that contradict each other, for each set in `unreached`; empty if the
            set is just out of reach.
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
        """Whether a base pose was found from which every target is reached."""
        return self.status is PlacementStatus.FOUND

    @property
    def best(self) -> Placement:
        """Best placement, the first one."""
        return self.placements[0]

    @property
    def here(self) -> bool:
        """Whether the current base pose is suitable."""
        return bool(self.reached[0].all() and not self.touching[0])

    @property
    def advice(self) -> str:
        """Advice on what to do next, in one sentence; two if only some unreached sets have contradictions."""
        if self.status is not PlacementStatus.UNREACHABLE or not any(self.conflicts):
            return self.status.advice
        return CONFLICT_ADVICE if all(self.conflicts) else f"{self.status.advice}  {CONFLICT_ADVICE}"

    def score_map(self, resolution: float = 0.1) -> PlacementMap:
        """Return the best scores of the tried base poses by cells of the floor; see `placement_map`.

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
        """Return the first line of the report."""
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
        """Return in words which unreached sets are too far and which are contradictory."""
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
        """Return a line for each set of tasks, with its errors at the best placement."""
        lines = []
        for k, result in enumerate(self.best.results):
            facts = "; ".join(
                f"{error.label}: error {words_for(error.value, error.unit)}" if error.met else error.shortfall
                for error in result.errors
            )
            lines.append(f"target {k + 1}: {facts}")
        return lines

    def _score(self) -> str:
        """Return a line with the score of the best placement and its terms."""
        terms, parts = self.best.terms, []
        if terms.limit_margin is not None:
            parts.append(f"{100 * terms.limit_margin:.0f} % of {terms.tightest_joint}'s range to its limit")
        if terms.manipulability is not None:
            parts.append(f"{100 * terms.manipulability:.0f} % of the largest manipulability")
        if terms.clearance is not None:
            parts.append(f"{1000 * terms.clearance:.1f} mm from obstacles")
        parts.append(f"{terms.distance:.2f} m and {math.degrees(terms.turn):.0f} deg to go")
        return f"score {self.best.score:.2f}: {', '.join(parts)}"
