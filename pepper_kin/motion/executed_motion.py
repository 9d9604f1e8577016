"""The motion that a live motion commanded in its cycles, as one trajectory."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion.live_motion import LiveState
from pepper_kin.trajectory.samples import TIME_TOLERANCE
from pepper_kin.trajectory.trajectory import Trajectory


def executed(states: Iterable[LiveState]) -> Trajectory:
    """Return the commanded motion of all cycles of one live motion, until rest, as one trajectory.

    It is q(t) = states[k].at(begin_0 + t), where k is the newest cycle at that time: each cycle counts until
    the next one begins, the last one to its end.  If a cycle came late, the robot rests at the end of the
    previous cycle's stop.  `executed(states).check(pepper, scene).report()` is the certificate of the whole
    motion.

    Args:
        states: All states that `LiveMotion.step` returned, in order.

    Raises:
        InvalidValueError: for no states, or if a state does not continue the previous one.
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
    """Return a trajectory until a time [s], extended by rest if it ends earlier."""
    if lasts <= sent.duration:
        return sent.between(0.0, lasts)
    rest = Trajectory(
        sent.joint_names, np.array([0.0, lasts - sent.duration]), sent.end[None, None], sent.joint_units
    )
    return sent.then(rest)


def _in_one(pieces: list[Trajectory]) -> Trajectory:
    """Join pieces pairwise, so that each is copied only about log2 of their number times."""
    while len(pieces) > 1:
        pairs = [first.then(second) for first, second in zip(pieces[::2], pieces[1::2], strict=False)]
        pieces = pairs + pieces[2 * len(pairs) :]
    return pieces[0]
