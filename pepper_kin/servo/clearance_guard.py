"""Keeps the body clear of itself and of the world: rows for the next velocity, and whether it can stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision import NearPairs, Scene, checker_for
from pepper_kin.collision.motion_tree import bounds_anywhere
from pepper_kin.collision.near_pairs import distances_along, pairs_within
from pepper_kin.core.braking import VelocityInterval, brake_path, ticks_to_rest
from pepper_kin.core.velocity_dampers import PairTable, clear_rows
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.servo.demand import Demand
from pepper_kin.servo.half_spaces import VelocityRows, stacked
from pepper_kin.servo.range_rows import range_rows

# Farthest that bodies are looked for [m], and how often one brake path is looked at again.
FARTHEST = 0.08
MAX_QUERIES = 4

# Share of the clearance that braking may use up.
HARD = 0.5

# Pairs nearer than that keep this share of their distance; pairs that touch may be found so much deeper [m].
STEP_OF_NEAR = 0.75
DEEPER = 1e-4

# Weight of the separation of near pairs, over the tasks.
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


@kept_for_robot(most=32)
def frame_motion_bounds(pepper: PepperModel) -> Array:
    """Return R, shape (n,) [m/rad or 1]: no point of the body moves by more than sum_i R_i |dq_i|."""
    return read_only(bounds_anywhere(pepper))


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
        self._motion_bounds = frame_motion_bounds(pepper)
        self._ranges = range_rows(pepper)
        self._clearance, self._gain = clearance, gain
        self._hard = HARD * clearance

    def look(self, q: Array, bounds: VelocityInterval, acceleration: Array, dt: float) -> NearPairs:
        """Return the pairs that matter at q for any velocity within bounds.

        Args:
            q: Joint positions [rad or m], shape (n,).
            bounds: Of the next velocity.
            acceleration: Of the brake [rad/s^2 or m/s^2], shape (n,).
            dt: Length of a tick [s].
        """
        fastest = np.maximum(np.abs(bounds.low), np.abs(bounds.high))
        damped = self._clearance + float(self._motion_bounds @ fastest) / self._gain
        last = np.array([ticks_to_rest(fastest, acceleration, dt)])
        stopped = self._hard + float(self._motion_bounds @ brake_path(fastest, acceleration, dt, last)[0])
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
        """Return the term that separates pairs nearer than d_min, at gain (d_min - d), or None."""
        short = near.distances < self._clearance
        if not short.any():
            return None
        rate = self._gain * (self._clearance - near.distances[short])
        return Demand(near.gradients[short], rate, PARTING, "clearance", 1.0, 0.0, 0.0)

    def obstacle(
        self, q: Array, v: Array, near: NearPairs, acceleration: Array, dt: float
    ) -> Obstacle | None:
        """Return None if one tick at v and the hardest brake after it stay clear; else what is in the way.

        Most pairs are shown to stay apart all the way by how far the joints can move them, see
        `core.velocity_dampers.clear_rows`; those of which this says nothing are measured at every tick of
        the way.  No pair may come nearer than half the clearance, or than 3/4 of its distance at q if that
        is less; pairs that touch at q may part, and else not go deeper.

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
        for _ in range(MAX_QUERIES):
            least = np.full(len(near), self._hard)
            if floors:
                least[:] = [floors.get(pair, self._hard) for pair in near.names]
            doubts = np.empty(len(near), dtype=bool)
            pairs = PairTable(
                near.gradients, near.movers, near.cores, self._motion_bounds, near.distances - least
            )
            clear = clear_rows(shifts, tick, pairs, near.within - self._hard, doubts)
            # So far no pair that was not seen can have come too near.
            if clear < 1:
                return everything
            doubtful = doubts.nonzero()[0]
            if doubtful.size:
                path = q + shifts[tick + 1 : tick + clear + 1]
                distances = distances_along(self._checker, path, near.indices[doubtful])
                hit = doubtful[(distances < least[doubtful]).any(axis=0)]
                if hit.size:
                    a, b = near.names[hit[0]]
                    return Obstacle(np.asarray(near.movers[hit].any(axis=0)), f"clearance of {a} and {b}")
            tick += clear
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
