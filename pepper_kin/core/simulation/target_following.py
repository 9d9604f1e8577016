"""Response of a joint to a sequence of targets: a cubic in time to each target, lag and backlash.

A target at a distance D of a command that moves at the speed u is reached at rest after a time T, along

    c(t) = c(0) + u t + (3 D - 2 u T) (t / T)^2 + (u T - 2 D) (t / T)^3,
    T = max(3 |D| / (2 v), sqrt(3 |D| / a), |u| / a):

from rest, v is the maximum speed, and a the maximum mean |acceleration| of the first and the last half.
Each new target starts a new cubic, however near the last target is.  This is how a robot was observed to
execute `setAngles`.  In cycles of h, the servo's lag L and the backlash 2 b between motor and link follow:

    x' = x + (1 - exp(-h / L)) (c' - x),   y' = clip(y, x' - b, x' + b).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2


class Following(NamedTuple):
    """Parameters of how one joint follows its targets.

    Attributes:
        cycle: h [s].
        fastest: v [rad/s or m/s].
        strongest: a [rad/s^2 or m/s^2].
        lag: L [s], 0 for none.
        backlash: b, half the play [rad or m], 0 for none.
    """

    cycle: float
    fastest: float
    strongest: float
    lag: float
    backlash: float


@compiled("float64(float64, float64, float64, float64)")
def time_to_target(way: float, speed: float, fastest: float, strongest: float) -> float:
    """Return the time T to the target [s].

    Args:
        way: D [rad or m].
        speed: u [rad/s or m/s].
        fastest: v [rad/s or m/s].
        strongest: a [rad/s^2 or m/s^2].
    """
    steady = max(1.5 * abs(way) / fastest, math.sqrt(3.0 * abs(way) / strongest))
    return max(steady, abs(speed) / strongest)


@compiled("float64(float64, float64, float64, float64)")
def way_to_target(way: float, speed: float, duration: float, time: float) -> float:
    """Return the displacement c(t) - c(0) of the command [rad or m]; D from T on.

    Args:
        way: D [rad or m].
        speed: u [rad/s or m/s].
        duration: T [s].
        time: t [s].
    """
    if time >= duration:
        return way
    part, run = time / duration, speed * duration
    return part * (run + part * (3.0 * way - 2.0 * run + part * (run - 2.0 * way)))


@compiled("void(float64[::1], float64[::1], Following, float64, float64, float64[::1])")
def follow_targets(
    times: Floats1, targets: Floats1, following: Following, begin: float, start: float, path: Floats1
) -> None:
    """Write the command of a joint at the ends of cycles.

    A target is used from the first cycle that starts at its time or later; u is the speed of the cycle
    before.

    Args:
        times: Times of the targets, ascending [s], shape (m,).
        targets: Targets [rad or m], shape (m,).
        following: Parameters of the joint; lag and backlash are not used.
        begin: Start time of the first cycle [s].
        start: Position at which the joint rests at that time [rad or m].
        path: Output: command at `begin + (k + 1) h`, shape (cycles,).
    """
    cycle, given = following.cycle, 0
    command, before, origin = start, start, start
    way, speed, duration, first = 0.0, 0.0, 0.0, 0
    for k in range(path.size):
        now = begin + k * cycle + 1e-9
        if given < times.size and times[given] <= now:
            while given < times.size and times[given] <= now:
                given += 1
            origin, way, first = command, targets[given - 1] - command, k
            speed = (command - before) / cycle
            duration = time_to_target(way, speed, following.fastest, following.strongest)
        before = command
        command = origin + way_to_target(way, speed, duration, (k + 1 - first) * cycle)
        path[k] = command


@compiled("void(Following, float64, float64[::1])")
def respond(following: Following, start: float, path: Floats1) -> None:
    """Replace commands at the ends of cycles by positions of the joint, with its lag and backlash.

    Args:
        following: Parameters of the joint.
        start: Position at which the joint rests initially [rad or m].
        path: Commands [rad or m], shape (cycles,); changed.
    """
    share = 1.0 if following.lag <= 0.0 else 1.0 - math.exp(-following.cycle / following.lag)
    servo, link, backlash = start, start, following.backlash
    for k in range(path.size):
        servo += share * (path[k] - servo)
        link = min(max(link, servo - backlash), servo + backlash)
        path[k] = link


@compiled("void(float64[::1], float64, float64, float64[::1], float64, float64[:, ::1])")
def read_path(
    path: Floats1, begin: float, cycle: float, times: Floats1, tolerance: float, readings: Floats2
) -> None:
    """Write interpolated readings of a path, and the path's range within a time of each reading.

    Args:
        path: Positions at `begin + (k + 1) h`, interpolated linearly, shape (cycles,).
        begin: Start time of the path [s].
        cycle: h [s].
        times: Times of the readings [s], shape (T,); beyond the ends the path rests.
        tolerance: Half the time over which the range is taken [s].
        readings: Output: position, minimum and maximum position, shape (3, T).
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
