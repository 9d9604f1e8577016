"""Tilting of robots about the edges of their wheels' support polygon, over time."""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

_NO_BOUNCE = 1e-3
"""Rate after an impact at level below which the tilt ends [rad/s]."""


class Hinges(NamedTuple):
    """N robots as bodies that hinge on k edges, at T times; shapes are (N, T, k) and (N,).

    Attributes:
        inertia: Moment of inertia about the edge [kg m^2].
        inside: Horizontal distance of the center of mass inward from the edge, while level [m].
        height: Height of the center of mass above the floor, while level [m].
        drive: Moment of the joints' motion and of external forces about the edge, positive outward [N m].
        weight: Weight of each robot [N].
    """

    inertia: Floats3
    inside: Floats3
    height: Floats3
    drive: Floats3
    weight: Floats1


class Tilts(NamedTuple):
    """Tilts of N robots at T times.

    Attributes:
        angle: Angle of the tilt [rad], shape (N, T).
        rate: Rate of the tilt [rad/s], shape (N, T).
        edge: Edge of the tilt, -1 while level, shape (N, T).
        ends: Time index at which each robot has fallen, T if it has not, shape (N,).
    """

    angle: Floats2
    rate: Floats2
    edge: Ints2
    ends: Ints1


class Rules(NamedTuple):
    """Parameters of the integration of tilts.

    Attributes:
        restitution: Ratio of the rate that is kept, reversed, at an impact at level.
        fallen_at: Tilt that counts as fallen [rad]; it stays.
        substep: Maximum step of the integration [s].
    """

    restitution: float
    fallen_at: float
    substep: float


@compiled("void(float64[::1], Hinges, Rules, Tilts)")
def follow_tilts(time: Floats1, hinges: Hinges, rules: Rules, tilts: Tilts) -> None:
    """Write the tilts of robots; see `pepper_kin.twin.base.simulate_tipping`.

    Args:
        time: Times [s], shape (T,).
        hinges: The robots.
        rules: Parameters of the integration.
        tilts: Column 0 is the initial state; the others are output.
    """
    for robot in range(len(tilts.angle)):
        tilts.ends[robot] = time.size
        for k in range(time.size - 1):
            angle, edge = tilts.angle[robot, k], tilts.edge[robot, k]
            if angle >= rules.fallen_at:
                tilts.angle[robot, k + 1], tilts.edge[robot, k + 1] = angle, edge
                tilts.rate[robot, k + 1] = tilts.rate[robot, k]
                tilts.ends[robot] = min(tilts.ends[robot], k)
                continue
            if edge < 0:
                edge = tilts.edge[robot, k] = _leaving(robot, k, hinges)
            tilts.angle[robot, k + 1], tilts.rate[robot, k + 1], tilts.edge[robot, k + 1] = 0.0, 0.0, -1
            if edge < 0:
                continue
            start = angle, tilts.rate[robot, k]
            angle, rate = _advanced(
                _Hinge(robot, k, edge), hinges, start, time[k + 1] - time[k], rules.substep
            )
            if angle <= 0.0:
                rate = -rules.restitution * rate
                if rate < _NO_BOUNCE:
                    continue
                angle = 0.0
            tilts.angle[robot, k + 1], tilts.rate[robot, k + 1], tilts.edge[robot, k + 1] = angle, rate, edge
        if tilts.angle[robot, -1] >= rules.fallen_at:
            tilts.ends[robot] = min(tilts.ends[robot], time.size - 1)


class _Hinge(NamedTuple):
    """Edge of a robot in the interval from one time to the next."""

    robot: int
    k: int
    edge: int


@compiled(lean=True)
def _leaving(robot: int, k: int, hinges: Hinges) -> int:
    """Return the edge about which a level robot starts to tilt, the most accelerated; -1 if none."""
    hardest, greatest = -1, 0.0
    for edge in range(hinges.inertia.shape[2]):
        held = hinges.weight[robot] * hinges.inside[robot, k, edge]
        pull = (hinges.drive[robot, k, edge] - held) / hinges.inertia[robot, k, edge]
        if pull > greatest:
            hardest, greatest = edge, pull
    return hardest


@compiled(lean=True)
def _between(at: _Hinge, series: Floats3, share: float) -> float:
    """Return a parameter at a fraction of the interval, interpolated linearly."""
    first, last = series[at.robot, at.k, at.edge], series[at.robot, at.k + 1, at.edge]
    return first + share * (last - first)


@compiled(lean=True)
def _rates(at: _Hinge, hinges: Hinges, share: float, tilt: float, momentum: float) -> tuple[float, float]:
    """Return the rates of tilt and momentum at a fraction of the interval."""
    inside, height = _between(at, hinges.inside, share), _between(at, hinges.height, share)
    moment = hinges.weight[at.robot] * (height * math.sin(tilt) - inside * math.cos(tilt))
    turning = momentum / _between(at, hinges.inertia, share)
    return turning, moment + _between(at, hinges.drive, share)


@compiled(lean=True)
def _advanced(
    at: _Hinge, hinges: Hinges, start: tuple[float, float], duration: float, substep: float
) -> tuple[float, float]:
    """Return tilt and rate after an interval with linear parameters (Runge-Kutta, fourth order)."""
    steps = max(math.ceil(duration / substep - 1e-9), 1)
    h, part = duration / steps, 1.0 / steps
    tilt, momentum = start[0], start[1] * _between(at, hinges.inertia, 0.0)
    for step in range(steps):
        share = step * part
        a1, m1 = _rates(at, hinges, share, tilt, momentum)
        a2, m2 = _rates(at, hinges, share + part / 2, tilt + h / 2 * a1, momentum + h / 2 * m1)
        a3, m3 = _rates(at, hinges, share + part / 2, tilt + h / 2 * a2, momentum + h / 2 * m2)
        a4, m4 = _rates(at, hinges, share + part, tilt + h * a3, momentum + h * m3)
        tilt += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        momentum += h / 6 * (m1 + 2 * m2 + 2 * m3 + m4)
        if tilt < 0.0:
            break
    return tilt, momentum / _between(at, hinges.inertia, 1.0)
