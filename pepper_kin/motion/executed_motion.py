"""The motion that the cycles of a live motion sent, as one trajectory."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion.live_motion import LiveState
from pepper_kin.trajectory.samples import TIME_TOLERANCE
from pepper_kin.trajectory.trajectory import Trajectory


def executed(states: Iterable[LiveState]) -> Trajectory:
    """Return what the cycles of one live motion sent, from the first cycle to rest, as one trajectory.

    It is q(t) = states[k].at(begin_0 + t), where k is the newest cycle: each until the next one began, the
    last to its end.  Where a cycle came late, the robot stands where the stop of the one before ended.
    `executed(states).check(pepper, scene).report()` is the certificate of the whole motion.

    Args:
        states: What `LiveMotion.step` returned, all of them, in order.

    Raises:
        InvalidValueError: for no states, or where one does not go on from the one before.
    """
    cycles = list(states)
    if not cycles or not all(isinstance(state, LiveState) for state in cycles):
        raise InvalidValueError("states", f"{len(cycles)} values", "what LiveMotion.step returned, in order")
    pieces = []
    for state, after in pairwise(cycles):
        lasts = after.begin - state.begin
        if lasts > TIME_TOLERANCE:
            pieces.append(_until(state.trajectory, lasts))
        elif lasts < 0.0:
            raise InvalidValueError("states", f"{after.begin} s after {state.begin} s", "times that rise")
    return _in_one([*pieces, cycles[-1].trajectory])


def _until(sent: Trajectory, lasts: float) -> Trajectory:
    """Return what was sent until a time [s], which rests where it has ended before."""
    if lasts <= sent.duration:
        return sent.between(0.0, lasts)
    rest = Trajectory(
        sent.joint_names, np.array([0.0, lasts - sent.duration]), sent.end[None, None], sent.joint_units
    )
    return sent.then(rest)


def _in_one(pieces: list[Trajectory]) -> Trajectory:
    """Return pieces one after the other, two and two: each is copied as often as the number has digits."""
    while len(pieces) > 1:
        pairs = [first.then(second) for first, second in zip(pieces[::2], pieces[1::2], strict=False)]
        pieces = pairs + pieces[2 * len(pairs) :]
    return pieces[0]
