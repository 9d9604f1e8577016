"""A joint that is sent from target to target: speed-limited interpolation, lag and backlash.

In cycles of h, a command c goes to the target g with a speed u that rises and falls with the acceleration a,

    wanted = sign(g - c) min(v, sqrt(2 a |g - c|), |g - c| / h),
    u' = u + clip(wanted - u, -a h, a h),   c' = c + h u',

and takes the target's place where it is nearer than one move.  That is how `setAngles` of NAOqi is simulated.
The servo's lag T and the backlash 2 b between motor and link follow:

    x' = x + (1 - exp(-h / T)) (c' - x),   y' = clip(y, x' - b, x' + b).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

SETTLED = 1e-4
"""A command has arrived within this distance of its target [rad or m]."""


class Following(NamedTuple):
    """How one joint follows its targets.

    Attributes:
        cycle: h [s].
        fastest: v, of the interpolation [rad/s or m/s].
        strongest: a, of the interpolation [rad/s^2 or m/s^2].
        lag: T [s], 0 for none.
        backlash: b, half the play [rad or m], 0 for none.
    """

    cycle: float
    fastest: float
    strongest: float
    lag: float
    backlash: float


@compiled("Tuple(float64, float64, boolean)(float64, float64, float64, float64, float64)")
def speed_step(
    left: float, speed: float, fastest: float, strongest: float, cycle: float
) -> tuple[float, float, bool]:
    """Return the move of one cycle [rad or m], the speed after it and whether the target is still ahead.

    Args:
        left: g - c, the way that is left [rad or m].
        speed: u [rad/s or m/s].
        fastest: v.
        strongest: a [rad/s^2 or m/s^2].
        cycle: h [s].
    """
    way = abs(left)
    wanted = math.copysign(min(fastest, math.sqrt(2.0 * strongest * way), way / cycle), left)
    speed += min(max(wanted - speed, -strongest * cycle), strongest * cycle)
    move = speed * cycle
    if way <= max(abs(move), SETTLED) and abs(speed) <= 2.0 * strongest * cycle:
        return left, 0.0, False
    return move, speed, True


@compiled("void(float64[::1], float64[::1], Following, float64, float64, float64[::1])")
def follow_targets(
    times: Floats1, targets: Floats1, following: Following, begin: float, start: float, path: Floats1
) -> None:
    """Write where a joint is at the ends of cycles.

    A target counts from the first cycle that begins at its time or later.

    Args:
        times: When targets are given, rising [s], shape (m,).
        targets: [rad or m], shape (m,).
        following: How the joint follows them.
        begin: Time of the first cycle's beginning [s].
        start: Where the joint rests at that time [rad or m].
        path: Receives the position at `begin + (k + 1) h`, shape (cycles,).
    """
    cycle, backlash = following.cycle, following.backlash
    share = 1.0 if following.lag <= 0.0 else 1.0 - math.exp(-cycle / following.lag)
    command, servo, link, target, speed, given = start, start, start, start, 0.0, 0
    for k in range(path.size):
        now = begin + k * cycle + 1e-9
        while given < times.size and times[given] <= now:
            target = targets[given]
            given += 1
        move, speed, _ = speed_step(target - command, speed, following.fastest, following.strongest, cycle)
        command += move
        servo += share * (command - servo)
        link = min(max(link, servo - backlash), servo + backlash)
        path[k] = link


@compiled("void(float64[::1], float64, float64, float64[::1], float64, float64[:, ::1])")
def read_path(
    path: Floats1, begin: float, cycle: float, times: Floats1, tolerance: float, readings: Floats2
) -> None:
    """Write what is read of a path, and the range of the path within a time of each reading.

    Args:
        path: Positions at `begin + (k + 1) h`, between which lines lie, shape (cycles,).
        begin: [s].
        cycle: h [s].
        times: Of the readings [s], shape (T,); beyond the ends the path rests.
        tolerance: Half the time over which the range is taken [s].
        readings: Receives position, least and greatest position, shape (3, T).
    """
    last = path.size - 1
    for i in range(times.size):
        place = min(max((times[i] - begin) / cycle - 1.0, 0.0), float(last))
        k = min(int(place), max(last - 1, 0))
        here = path[k] + (place - k) * (path[min(k + 1, last)] - path[k])
        low = high = here
        first = max(math.ceil(place - tolerance / cycle), 0.0)
        beyond = min(math.floor(place + tolerance / cycle), float(last)) + 1.0
        for j in range(int(first), int(beyond)):
            low, high = min(low, path[j]), max(high, path[j])
        readings[0, i], readings[1, i], readings[2, i] = here, low, high
