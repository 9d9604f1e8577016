"""Keeps the body clear of itself and of the world: rows for the next velocity, and whether it can stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from pepper_kin.collision import NearPairs, Scene, checker_for
from pepper_kin.collision.near_pairs import distances_along, pairs_within
from pepper_kin.ik.servo.braking import VelocityBounds, brake_path, ticks_to_rest
from pepper_kin.ik.servo.demand import Demand
from pepper_kin.ik.servo.half_spaces import VelocityRows, stacked
from pepper_kin.ik.servo.lever_arms import lever_arms
from pepper_kin.ik.servo.range_rows import range_rows
from pepper_kin.ik.tasks.task import Array
from pepper_kin.kernels.compilation import Compilation
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import read_only

# Farthest that bodies are looked for [m], and how often one brake path is looked at anew.
FARTHEST = 0.08
LOOKS = 4

# Share of the clearance that braking may use up.
HARD = 0.5

# Pairs nearer than that keep this share of their distance; pairs that touch may be found so much deeper [m].
STEP_OF_NEAR = 0.75
DEEPER = 1e-4

# Weight of the wish to part, over the tasks.
PARTING = 10.0


@dataclass(frozen=True, eq=False)
class Obstacle:
    """What keeps a velocity from being known to be safe.

    Attributes:
        joints: The joints that have to brake, shape (n,).
        name: What they would come too near, in words.
    """

    joints: np.ndarray
    name: str


class ClearanceGuard:
    """Velocity dampers on near pairs, and a look along the brake path.

    Damper (Faverjon and Tournassoud, A local based approach for path planning of manipulators with a high
    number of degrees of freedom, 1987): g . v >= -gain max(d - d_min, 0) with g = dd/dq.
    Pairs nearer than d_min may only part, and are asked to: see `parting`.

    Args:
        pepper: The robot.
        scene: The world; an empty one checks the robot against itself.
        clearance: d_min [m].
        gain: Share of the free distance that may be used up per second [1/s].
    """

    def __init__(self, pepper: PepperModel, scene: Scene, clearance: float, gain: float) -> None:
        self._checker = checker_for(pepper, scene)
        self._levers = lever_arms(pepper)
        self._ranges = range_rows(pepper)
        self._clearance, self._gain = clearance, gain
        self._hard = HARD * clearance
        if not _look_along.signatures:
            self._load(pepper)

    def _load(self, pepper: PepperModel) -> None:
        """Compile, or read from disk, here and not in the first tick what the look along a way needs."""
        first = Compilation("the servo's look at distances")
        near = pairs_within(self._checker, pepper.neutral(), FARTHEST)
        still, dt = np.zeros(pepper.n), 1.0
        limits = read_only(np.ones(pepper.n))
        self.rows(pepper.neutral(), pepper.neutral(), near, 1.0)
        self.obstacle(pepper.neutral(), still, near, limits, dt)
        first.end(compiled=bool(_look_along.stats.cache_misses))

    def look(self, q: Array, bounds: VelocityBounds, acceleration: Array, dt: float) -> NearPairs:
        """Return the pairs that matter at q for any velocity within bounds."""
        fastest = np.maximum(np.abs(bounds.low), np.abs(bounds.high))
        damped = self._clearance + float(self._levers @ fastest) / self._gain
        last = np.array([ticks_to_rest(fastest, acceleration, dt)])
        stopped = self._hard + float(self._levers @ brake_path(fastest, acceleration, dt, last)[0])
        return pairs_within(self._checker, q, min(max(damped, stopped), FARTHEST))

    def rows(self, q: Array, stop: Array, near: NearPairs, caution: float) -> VelocityRows:
        """Return the dampers at q.

        Args:
            q: Joint positions [rad or m], shape (n,).
            stop: Where the hardest brake would end, shape (n,).
            near: What `look` returned there.
            caution: Factor on the gain, up to 1.
        """
        gain = self._gain * caution
        least = -gain * np.maximum(near.distances - self._clearance, 0.0)
        names = tuple([f"clearance of {a} and {b}" for a, b in near.names])
        return stacked(
            [VelocityRows(near.gradients, least, names), self._ranges.rows(q, stop, gain)],
            near.gradients.shape[1],
        )

    def parting(self, near: NearPairs) -> Demand | None:
        """Return the wish that pairs nearer than d_min part, at gain (d_min - d); None for no such pair."""
        short = near.distances < self._clearance
        if not short.any():
            return None
        rate = self._gain * (self._clearance - near.distances[short])
        return Demand(near.gradients[short], rate, PARTING, "clearance", 1.0, 0.0, 0.0)

    def obstacle(
        self, q: Array, v: Array, near: NearPairs, acceleration: Array, dt: float
    ) -> Obstacle | None:
        """Return None if one tick at v and the hardest brake after it stay clear; else what is in the way.

        Most pairs are shown to stay apart all the way by how far the joints can move them, see `_look_along`;
        those of which this says nothing are measured at every tick of the way.  No pair may come nearer than
        half the clearance, or than 3/4 of its distance at q if that is less; pairs that touch at q may part,
        and else not go deeper.

        Args:
            q: Joint positions [rad or m], shape (n,).
            v: The velocity proposed [rad/s or m/s], shape (n,).
            near: What `look` returned at q.
            acceleration: Of the brake [rad/s^2 or m/s^2], shape (n,).
            dt: Length of a tick [s].
        """
        end = ticks_to_rest(v, acceleration, dt)
        shifts = brake_path(v, acceleration, dt, np.arange(end + 1))
        entered = self._ranges.entered(q, q + shifts[1:])
        if entered is not None:
            return Obstacle(np.isin(np.arange(q.size), entered[0]), entered[1])
        floors, tick = self._floors(near), 0
        everything = Obstacle(np.ones(q.size, dtype=bool), "clearance")
        for _ in range(LOOKS):
            least = np.full(len(near), self._hard)
            if floors:
                least[:] = [floors.get(pair, self._hard) for pair in near.names]
            seen, doubts = _look_along(
                shifts, tick, near.gradients, near.movers, near.cores, self._levers,
                near.distances - least, near.within - self._hard,
            )  # fmt: skip
            # So far no pair that was not seen can have come too near.
            if seen < 1:
                return everything
            doubtful = doubts.nonzero()[0]
            if doubtful.size:
                path = q + shifts[tick + 1 : tick + seen + 1]
                distances = distances_along(self._checker, path, near.indices[doubtful])
                hit = doubtful[(distances < least[doubtful]).any(axis=0)]
                if hit.size:
                    a, b = near.names[hit[0]]
                    return Obstacle(np.asarray(near.movers[hit].any(axis=0)), f"clearance of {a} and {b}")
            tick += seen
            if tick >= end:
                return None
            near = pairs_within(self._checker, q + shifts[tick], FARTHEST)
        return everything

    def _floors(self, near: NearPairs) -> dict[tuple[str, str], float]:
        """Return how near those pairs may come that are near already; the least of equal names."""
        floors: dict[tuple[str, str], float] = {}
        for pair, distance in zip(near.names, near.distances.tolist(), strict=True):
            if distance > self._hard / STEP_OF_NEAR:
                break
            floors.setdefault(pair, STEP_OF_NEAR * distance if distance > 0 else distance - DEEPER)
        return floors


@njit(cache=True, nogil=True, error_model="numpy")
def _look_along(
    shifts: Array, first: int, gradients: Array, movers: np.ndarray, cores: Array, levers: Array,
    spare: Array, reach: float,
) -> tuple[int, np.ndarray]:  # fmt: skip
    """Return how far along a path pairs that were not seen stay away, and which of those seen may not.

    By changes dq of position no point moves by more than sum R |dq| over the joints that move a pair.  And
    the plane between the two bodies, taken along with the one, still parts them after the other has come
    nearer by no more than

        -g . dq + w L + w sum(R |dq|) / 2,    w = sum |dq|,

    with L the straight part of the shape (what turning adds) and the last term for second order.  A pair's
    distance has shrunk by no more than the smaller of both.

    Args:
        shifts: Positions along the path, shape (m, n) [rad or m].
        first: Row of `shifts` where the pairs are known; dq is counted from there.
        gradients: g, shape (k, n).
        movers: Which joints move each pair, shape (k, n).
        cores: L, shape (k,) [m].
        levers: R, shape (n,) [m/rad or 1].
        spare: By how much the distances may shrink, shape (k,) [m].
        reach: By how much those of pairs that were not seen may [m].

    Returns:
        How many rows after `first` no pair unseen comes too near, -1 where that cannot be said of `first`;
        and for each pair whether more than its spare may be used up until then, shape (k,).
    """
    doubts = np.zeros(spare.size, dtype=np.bool_)
    turned = np.empty(levers.size)
    for row in range(first, shifts.shape[0]):
        travel = 0.0
        for i in range(levers.size):
            turned[i] = abs(shifts[row, i] - shifts[first, i])
            travel += levers[i] * turned[i]
        if travel > reach:
            return row - first - 1, doubts
        for k in range(spare.size):
            if doubts[k]:
                continue
            lever, turn, plane = 0.0, 0.0, 0.0
            for i in range(levers.size):
                plane -= gradients[k, i] * (shifts[row, i] - shifts[first, i])
                if movers[k, i]:
                    turn += turned[i]
                    lever += levers[i] * turned[i]
            plane += turn * cores[k] + 0.5 * turn * lever
            doubts[k] = min(lever, plane) > spare[k]
    return shifts.shape[0] - first - 1, doubts
