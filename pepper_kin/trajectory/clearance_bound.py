"""The least clearance of a motion, proven between the states at which it is measured."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pepper_kin import collision
from pepper_kin.arrays import Array

if TYPE_CHECKING:
    from pepper_kin.collision import LeastClearance, Scene
    from pepper_kin.collision.checked_shapes import PairsTo
    from pepper_kin.model import PepperModel
    from pepper_kin.trajectory.trajectory import Trajectory

STATES = 32
"""Intervals between the states of a stretch that is looked at once."""
PARTS = 4
"""Stretches that a stretch is cut into where its bound does not suffice."""
FINEST = 1e-6
"""Bound [m] beyond what is asked below which no stretch is cut: distances by coal are off by as much."""
MOST_STRETCHES = 2000
"""Stretches that are looked at; motions that keep less than some micrometers for long would take more."""


class ProvenClearance(NamedTuple):
    """What was found.

    Attributes:
        nearest: The least distance that was measured, and its pair.
        time: Its time from the start of the motion [s].
        bound: What no distance is below, between the states too [m].
        forbidden: The first time at which a table of joint ranges forbids the posture [s]; None for never.
    """

    nearest: LeastClearance
    time: float
    bound: float
    forbidden: float | None


class Pieces(NamedTuple):
    """Pieces of a motion.

    Attributes:
        breaks: Their ends [s], shape (m + 1,).
        rates: Bounds on |dq/dt| on each [rad/s or m/s], shape (m, n).
    """

    breaks: Array
    rates: Array


def proven_clearance(
    pepper: PepperModel,
    motion: Trajectory,
    times: Array,
    pieces: Pieces,
    scene: Scene,
    start_time: float,
    to: PairsTo,
    least: float = 0.0,
) -> ProvenClearance:
    """Return the least distance along a motion, and a bound for all of it.

    A distance that shrinks at most with the speed v is, between two states h apart, no more than v h / 2
    below the lesser of its values there.  Where that does not suffice to prove that the least distance asked
    is kept, the motion is cut into stretches with speeds of their own, and these into shorter ones, until it
    does, until something is nearer, or until v h / 2 is less than `FINEST`.

    Args:
        pepper: The robot.
        motion: Its motion.
        times: Regular times of it [s], shape (T,).
        pieces: Its pieces.
        scene: The world around it.
        start_time: Time of the scene at which the motion begins [s].
        to: Which pairs count: "self" or "obstacles".
        least: The least distance asked [m].
    """
    found = collision.least_clearance(pepper, motion(times).position, scene, start_time + times, to=to)
    at = float(times[found.index])
    forbidden = None if found.forbidden is None else float(times[found.forbidden])
    step = float(np.diff(times).max(initial=0.0))
    bound = found.distance - 0.5 * step * collision.approach_speed(pepper, pieces.rates, scene)
    if bound > least or found.distance <= least:
        return ProvenClearance(found, at, min(bound, found.distance), forbidden)
    ends = np.unique(np.append(np.arange(0.0, motion.duration, STATES * step), motion.duration))
    waiting = list(pairwise(ends.tolist()))[::-1]
    bound, looked = np.inf, 0
    while waiting:
        start, end = waiting.pop()
        local = np.linspace(start, end, STATES + 1)
        nearest = collision.least_clearance(pepper, motion(local).position, scene, start_time + local, to=to)
        if nearest.distance < found.distance:
            found, at = nearest, float(local[nearest.index])
        if forbidden is None and nearest.forbidden is not None:
            forbidden = float(local[nearest.forbidden])
        looked += 1
        first, last = np.searchsorted(pieces.breaks, [start, end], side="right")
        rates = pieces.rates[max(first - 1, 0) : last]
        between = 0.5 * (end - start) / STATES * collision.approach_speed(pepper, rates, scene)
        enough = nearest.distance > least + between or nearest.distance <= least or between < FINEST
        if enough:
            bound = min(bound, nearest.distance - between)
        else:
            cuts = np.linspace(start, end, PARTS + 1).tolist()
            waiting += list(pairwise(cuts))[::-1]
        if found.distance <= least:
            break
        if looked >= MOST_STRETCHES:
            bound = -np.inf  # nothing is known of the stretches that wait
            break
    return ProvenClearance(found, at, min(bound, found.distance), forbidden)
