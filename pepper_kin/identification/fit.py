"""Fit of the joints' response to `setAngles` to logs of a robot."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, BriefRepr
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.identification.replay import (
    CYCLE,
    SETTLE,
    SPREAD,
    best_round_trip,
    command_path,
    gravity_droop,
    holding_torque,
    joint_path,
    kept_off,
    read_at,
    times_of,
)
from pepper_kin.identification.robot_log import RobotLog
from pepper_kin.model import PepperModel
from pepper_kin.twin.joint_response import RESPONSE_QUANTITIES, JointResponse, joint_response

START = {"speed_share": 0.95, "latency": 0.04, "lag": 0.09, "backlash": 0.002, "compliance": 0.0}
"""Initial values of the search."""

STEPS = {"speed_share": 0.01, "latency": 0.004, "lag": 0.004, "backlash": 5e-4, "compliance": 1e-4}
"""Steps of the central differences."""

RANGES = {
    "speed_share": (0.05, 3.0),
    "latency": (0.0, 0.5),
    "lag": (0.0, 1.0),
    "backlash": (0.0, 0.05),
    "compliance": (0.0, 0.02),
}
"""Ranges of the search."""

SHARES = np.arange(0.6, 1.4, 0.02)
"""Speed ratios from which a search starts with the best: the error has several minima over the ratio."""

DROOP = 0.006
"""Minimum displacement of a joint by gravity [rad]: a smaller one cannot be separated from backlash."""

KEPT_OFF, AROUND = 0.004, 0.6
"""Displacement of an arm joint by the protection above which readings are ignored [rad], and time before and
after in which they are ignored, too [s]."""

ROUNDS = 3
RESAMPLES = 2000
_ITERATIONS = 8
_SMALL = 1e-5


@dataclass(frozen=True, eq=False)
class Fit(BriefRepr):
    """Responses of joints, fitted to logs.

    Attributes:
        response: Response of the joints of the logs, with 95 % intervals over persons; NaN with fewer than
            three persons, and for quantities that are not fitted.
        without: Person -> response fitted without that person's logs.
        round_trips: Log -> time of a call to the robot and back [s].
        persons: Persons of the logs.
        readings: Number of readings of each joint that counted, shape (n,).
    """

    response: JointResponse
    without: dict[str, JointResponse]
    round_trips: dict[str, float]
    persons: tuple[str, ...]
    readings: NDArray[np.int64]

    def report(self) -> str:
        """Return a table: value and interval of each quantity and joint."""
        lines = [f"{'joint':<15}" + "".join(f"{quantity:>24}" for quantity in RESPONSE_QUANTITIES)]
        for j, joint in enumerate(self.response.joint_names):
            cells = []
            for quantity in RESPONSE_QUANTITIES:
                low, high = self.response.intervals[quantity][j]
                interval = f"{low:6.4f}..{high:6.4f}" if np.isfinite(low) else "not fitted"
                cells.append(f"{getattr(self.response, quantity)[j]:.4f} {interval:>14}")
            lines.append(f"{joint:<15}" + "".join(f"{cell:>24}" for cell in cells))
        return "\n".join(lines)


class _Data(NamedTuple):
    """Readings of one joint in one log.

    Attributes:
        log: The log.
        times: Times of the readings [s], shape (T,).
        measured: Measured angles [rad], shape (T,).
        torque: Torques that hold the joint against gravity [N m], shape (T,).
        use: Which readings count, shape (T,).
    """

    log: RobotLog
    times: Array
    measured: Array
    torque: Array
    use: NDArray[np.bool_]


def fit_actuators(
    pepper: PepperModel,
    logs: Sequence[RobotLog],
    free: Iterable[str] = RESPONSE_QUANTITIES,
    *,
    start: JointResponse | None = None,
    seed: int = 0,
) -> Fit:
    """Fit the response of joints to `setAngles` to logs.

    For each joint the sum of log(1 + (e / 20 mrad)^2) is minimized, e the twin's angle minus the robot's:
    deviations that no actuator explains hardly count (Cauchy distribution), and arms that are kept off the
    body do not.  The method is Gauss-Newton with these weights; the common latency of all joints and each
    log's round trip are fitted in turns with the joints.  Intervals: persons are drawn with replacement, and
    each draw takes one Gauss-Newton step from the common fit (Andrews, Econometrica 70, 2002); they have at
    least 1.96 standard deviations by the jackknife over persons.  A compliance is undetermined, and set to 0,
    if its interval contains 0 or the end of its range, or if by it gravity moves the joint by less than
    6 mrad from the 5th to the 95th percentile of the joint's torques.

    Args:
        pepper: The robot.
        logs: Logs of the same joints; intervals need logs of three persons.
        free: Names in `RESPONSE_QUANTITIES` that are fitted.
        start: Initial values of the search, and values of quantities that are not free.
        seed: Seed of the draws.

    Raises:
        InvalidValueError: for no log, or logs of different joints.
        UnknownNameError: for an unknown quantity or joint.
    """
    chosen = tuple(free)
    for quantity in chosen:
        if quantity not in RESPONSE_QUANTITIES:
            raise UnknownNameError("quantity of a response", quantity, RESPONSE_QUANTITIES)
    joints = _checked(pepper, logs)
    response = _start(joints, start)
    problem = _FitProblem(
        pepper, tuple(logs), dict.fromkeys(joints, chosen), {}, used_readings(pepper, logs, response)
    )
    problem = problem._replace(trips=_best_trips(problem, response))
    response, problem, without = _solved(problem, response, ROUNDS)
    response = _with_intervals(problem, response, without, seed)
    free_now = {
        joint: _determined(problem, readings, response, joint)
        for joint, readings in zip(joints, _data(problem, response), strict=True)
    }
    if free_now != problem.free:
        loose = [joint for joint in joints if free_now[joint] != chosen]
        response = replace(response.changed(compliance=dict.fromkeys(loose, 0.0)), intervals={})
        response, problem, without = _solved(problem._replace(free=free_now), response, 1)
        response = _with_intervals(problem, response, without, seed)
    persons = tuple(sorted({log.person for log in logs}))
    counted = sum((problem.use[id(log)].sum(axis=0) for log in logs), np.zeros(len(joints), dtype=np.int64))
    trips = {log.name: problem.trips[id(log)] for log in logs}
    return Fit(response, without, trips, persons, counted)


class _FitProblem(NamedTuple):
    """Logs and free quantities of a fit.

    Attributes:
        pepper: The robot.
        logs: Logs of the robot.
        free: Joint -> quantities that are fitted.
        trips: Identity of a log -> round trip [s].
        use: Identity of a log -> which readings count, shape (T, n).
    """

    pepper: PepperModel
    logs: tuple[RobotLog, ...]
    free: dict[str, tuple[str, ...]]
    trips: dict[int, float]
    use: dict[int, NDArray[np.bool_]]


def _solved(
    problem: _FitProblem, response: JointResponse, rounds: int
) -> tuple[JointResponse, _FitProblem, dict[str, JointResponse]]:
    """Return the best response, the problem with its round trips, and the best without each person."""
    response, problem = _in_turns(problem, response, rounds)
    persons = sorted({log.person for log in problem.logs})
    without = {}
    for person in persons if len(persons) > 2 else ():
        others = tuple(log for log in problem.logs if log.person != person)
        without[person], _ = _in_turns(problem._replace(logs=others), response, 1)
    return response, problem, without


def _in_turns(
    problem: _FitProblem, response: JointResponse, rounds: int
) -> tuple[JointResponse, _FitProblem]:
    """Fit response and round trips in turns; return both."""
    for _ in range(rounds):
        response = _fitted(problem, response)
        problem = problem._replace(trips=_best_trips(problem, response))
        response, problem = _mirrored(problem, response)
    return _fitted(problem, response), problem


def _mirrored(problem: _FitProblem, response: JointResponse) -> tuple[JointResponse, _FitProblem]:
    """Shift round trips so that left and right joints have the same mean lag.

    A delay d of the readings per round trip has the same effect as lags that are longer by d x
    `reading_order`.  The joints of the left and the right arm have the same design and are read one after
    the other, so d is the delay that makes their mean lags equal.
    """
    order = problem.logs[0].reading_order
    pairs = [
        (j, response.joint_names.index("R" + joint[1:]))
        for j, joint in enumerate(response.joint_names)
        if joint.startswith("L") and "R" + joint[1:] in response.joint_names
    ]
    pairs = [(left, right) for left, right in pairs if order[left] != order[right]]
    if not pairs or any("lag" not in free for free in problem.free.values()):
        return response, problem
    shift = float(np.mean([(response.lag[a] - response.lag[b]) / (order[b] - order[a]) for a, b in pairs]))
    shift = max(shift, -min(problem.trips[id(log)] for log in problem.logs))
    later = shift * order
    common = float(later.mean()) if all("latency" in free for free in problem.free.values()) else 0.0
    lag = np.clip(response.lag + later - common, *RANGES["lag"])
    latency = np.clip(response.latency + common, *RANGES["latency"])
    trips = {log: trip + shift for log, trip in problem.trips.items()}
    return response.changed(lag=lag, latency=latency), problem._replace(trips=trips)


def _determined(
    problem: _FitProblem, readings: list[_Data], response: JointResponse, joint: str
) -> tuple[str, ...]:
    """Return the free quantities of a joint without a compliance that its logs do not determine."""
    free = problem.free[joint]
    if "compliance" not in free:
        return free
    j = response.index(joint)
    torque = np.concatenate([one.torque[one.use] for one in readings])
    droop = response.compliance[j] * np.ptp(np.percentile(torque, [5, 95])) if torque.size else 0.0
    low, high = response.intervals["compliance"][j]
    least, greatest = RANGES["compliance"]
    sure = bool(np.isnan(low)) or (least < low and high < greatest)
    return free if sure and droop > DROOP else tuple(q for q in free if q != "compliance")


def _checked(pepper: PepperModel, logs: Sequence[RobotLog]) -> tuple[str, ...]:
    """Return the joints of logs; refuse no log, different joints, or joints that the robot lacks."""
    if not logs:
        raise InvalidValueError("logs", "none", "at least one")
    joints = logs[0].joint_names
    for log in logs:
        if log.joint_names != joints:
            raise InvalidValueError(f"joints of {log.name}", ", ".join(log.joint_names), ", ".join(joints))
    for joint in joints:
        pepper.joint_index(joint)
    return joints


def _start(joints: tuple[str, ...], start: JointResponse | None) -> JointResponse:
    """Return the initial response of joints: `START`, or values of a given response."""
    if start is None:
        values = {quantity: np.full(len(joints), START[quantity]) for quantity in RESPONSE_QUANTITIES}
    else:
        places = [start.index(joint) for joint in joints]
        values = {quantity: getattr(start, quantity)[places] for quantity in RESPONSE_QUANTITIES}
    return JointResponse(joints, **values, intervals={}, sources=("fitted",) * len(joints))


def used_readings(
    pepper: PepperModel, logs: Sequence[RobotLog], response: JointResponse
) -> dict[int, NDArray[np.bool_]]:
    """Return which readings of each log count: all but readings of arms that are kept off the body."""
    used, around = {}, np.ones(2 * round(AROUND / CYCLE) + 1)
    for log in logs:
        use = log.arrived() & (log.time >= log.time[0] + SETTLE)[:, None]
        commands = np.array([command_path(pepper, log, response, joint) for joint in log.joint_names])
        moved = np.abs(kept_off(pepper, log, commands) - commands) > KEPT_OFF
        cycles = np.clip(((log.time - log.begin) / CYCLE).astype(int), 0, commands.shape[1] - 1)
        for side in "LR":
            arm = [j for j, joint in enumerate(log.joint_names) if joint.startswith(side)]
            use[:, arm] &= (np.convolve(moved[arm].any(axis=0), around, "same") < 0.5)[cycles][:, None]
        used[id(log)] = use
    return used


def _best_trips(problem: _FitProblem, response: JointResponse) -> dict[int, float]:
    """Return the round trip of each log with a response."""
    found = {}
    for log in problem.logs:
        paths = [joint_path(problem.pepper, log, response, joint) for joint in log.joint_names]
        rigid = log.measured - gravity_droop(problem.pepper, log, response, paths)
        found[id(log)] = best_round_trip(log, paths, rigid, problem.use[id(log)])
    return found


def _data(problem: _FitProblem, response: JointResponse) -> list[list[_Data]]:
    """Return the readings by joint and log."""
    data: list[list[_Data]] = [[] for _ in response.joint_names]
    for log in problem.logs:
        paths = [joint_path(problem.pepper, log, response, joint) for joint in log.joint_names]
        torque, used = holding_torque(problem.pepper, log, paths), problem.use[id(log)]
        for j in range(len(log.joint_names)):
            times = times_of(log, j, problem.trips[id(log)])
            data[j].append(_Data(log, times, log.measured[:, j], torque[:, j], used[:, j]))
    return data


def _fitted(problem: _FitProblem, response: JointResponse) -> JointResponse:
    """Return the response that fits logs best, with given round trips."""
    data = _data(problem, response)
    for joint, readings in zip(response.joint_names, data, strict=True):
        own = tuple(quantity for quantity in problem.free[joint] if quantity != "latency")
        response = _fit_joint(problem.pepper, readings, response, own, joint)
    if all("latency" in free for free in problem.free.values()):
        response = _fit_latency(problem.pepper, data, response)
    return response


def _fit_latency(pepper: PepperModel, data: list[list[_Data]], response: JointResponse) -> JointResponse:
    """Return the response with the best common latency of all joints, by Gauss-Newton steps."""
    for _ in range(3):
        slope = force = 0.0
        for joint, readings in zip(response.joint_names, data, strict=True):
            slopes, forces = _normal_equations(pepper, readings, response, ("latency",), joint)
            slope, force = slope + float(slopes.sum()), force + float(forces.sum())
        latency = float(np.clip(response.latency[0] - force / max(slope, 1e-12), *RANGES["latency"]))
        response = response.changed(latency=latency)
    return response


def _fit_joint(
    pepper: PepperModel, data: list[_Data], response: JointResponse, free: tuple[str, ...], joint: str
) -> JointResponse:
    """Return the response with the best values of one joint, by damped Gauss-Newton steps."""
    if not free:
        return response
    if "speed_share" in free:
        response = _best_share(pepper, data, response, joint)
    damping = 1e-3
    cost = _cost(np.concatenate(_errors(pepper, data, response, joint)))
    for _ in range(_ITERATIONS):
        slopes, force = _normal_equations(pepper, data, response, free, joint)
        matrix, vector = slopes.sum(axis=0), force.sum(axis=0)
        for _ in range(6):
            move = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix) + 1e-12), vector)
            tried = _moved(response, free, joint, move)
            better = _cost(np.concatenate(_errors(pepper, data, tried, joint)))
            if better < cost:
                break
            damping *= 10.0
        else:
            return response
        gain, cost, response, damping = cost - better, better, tried, 0.1 * damping
        if gain < _SMALL * cost:
            return response
    return response


def _best_share(pepper: PepperModel, data: list[_Data], response: JointResponse, joint: str) -> JointResponse:
    """Return the response with the best speed ratio of `SHARES`, or its own ratio if that is better."""
    tried = [response, *(response.changed(speed_share={joint: float(share)}) for share in SHARES)]
    costs = [_cost(np.concatenate(_errors(pepper, data, one, joint))) for one in tried]
    return tried[int(np.argmin(costs))]


def _moved(response: JointResponse, free: tuple[str, ...], joint: str, move: Array) -> JointResponse:
    """Return a response with a step added to the free quantities of a joint, within `RANGES`."""
    j = response.index(joint)
    values = {
        quantity: {joint: float(np.clip(getattr(response, quantity)[j] + step, *RANGES[quantity]))}
        for quantity, step in zip(free, move, strict=True)
    }
    return response.changed(**values)


def _cost(error: Array) -> float:
    return float(np.log1p((error / SPREAD) ** 2).sum())


def _errors(pepper: PepperModel, data: list[_Data], response: JointResponse, joint: str) -> list[Array]:
    """Return twin minus robot for the readings that count [rad], one array per log."""
    compliance = response.compliance[response.index(joint)]
    return [
        (
            read_at(joint_path(pepper, one.log, response, joint), one.log, one.times)
            - compliance * one.torque
            - one.measured
        )[one.use]
        for one in data
    ]


def _normal_equations(
    pepper: PepperModel, data: list[_Data], response: JointResponse, free: tuple[str, ...], joint: str
) -> tuple[Array, Array]:
    """Return J^T W J and J^T W e of each log, shapes (logs, k, k) and (logs, k), W the Cauchy weights."""
    errors = _errors(pepper, data, response, joint)
    columns = []
    j = response.index(joint)
    for quantity in free:
        value, step = float(getattr(response, quantity)[j]), STEPS[quantity]
        low, high = max(value - step, RANGES[quantity][0]), min(value + step, RANGES[quantity][1])
        above = _errors(pepper, data, response.changed(**{quantity: {joint: high}}), joint)
        below = _errors(pepper, data, response.changed(**{quantity: {joint: low}}), joint)
        columns.append([(a - b) / (high - low) for a, b in zip(above, below, strict=True)])
    slopes = np.empty((len(data), len(free), len(free)))
    force = np.empty((len(data), len(free)))
    for i, error in enumerate(errors):
        jacobian = np.column_stack([column[i] for column in columns])
        weighted = jacobian / (1.0 + (error / SPREAD) ** 2)[:, None]
        slopes[i], force[i] = weighted.T @ jacobian, weighted.T @ error
    return slopes, force


def _with_intervals(
    problem: _FitProblem, response: JointResponse, without: dict[str, JointResponse], seed: int
) -> JointResponse:
    """Return a response with its intervals, from draws of persons and from the fits without each person."""
    persons = sorted(without)
    if not persons:
        return response
    rng = np.random.default_rng(seed)
    draws = rng.multinomial(len(persons), np.full(len(persons), 1.0 / len(persons)), size=RESAMPLES)
    weights = draws[:, [persons.index(log.person) for log in problem.logs]].astype(float)
    n = len(response.joint_names)
    intervals = {quantity: np.full((n, 2), np.nan) for quantity in RESPONSE_QUANTITIES}
    equations = []
    for joint, readings in zip(response.joint_names, _data(problem, response), strict=True):
        free = problem.free[joint]
        equations.append((free, *_normal_equations(problem.pepper, readings, response, free, joint)))
    shared = np.zeros((2, len(problem.logs)))  # J^T W J and J^T W e of the common latency
    for free, slopes, force in equations:
        if "latency" in free:
            place = free.index("latency")
            shared += slopes[:, place, place], force[:, place]
    for j, (free, slopes, force) in enumerate(equations):
        own = [place for place, quantity in enumerate(free) if quantity != "latency"]
        moves = np.zeros((RESAMPLES, len(free)))
        if own:
            moves[:, own] = _moves(weights, slopes[:, own][:, :, own], force[:, own])
        if len(own) < len(free):
            moves[:, free.index("latency")] = _moves(weights, shared[0][:, None, None], shared[1][:, None])[
                :, 0
            ]
        moves *= np.sqrt(len(persons) / (len(persons) - 1.0))  # corrects the smaller spread of few persons
        for k, quantity in enumerate(free):
            value = getattr(response, quantity)[j]
            low, high = value + np.percentile(moves[:, k], [2.5, 97.5])
            others = np.array([getattr(one, quantity)[j] for one in without.values()])
            wide = 1.96 * np.sqrt((others.size - 1.0) * np.mean((others - others.mean()) ** 2))
            ends = min(low, value - wide), max(high, value + wide)
            intervals[quantity][j] = np.clip(ends, *RANGES[quantity])
    return replace(response, intervals=intervals)


def _moves(weights: Array, slopes: Array, force: Array) -> Array:
    """Return one Gauss-Newton step for each draw, shape (draws, k).

    Args:
        weights: Number of times that each log was drawn, shape (draws, logs).
        slopes: J^T W J, shape (logs, k, k).
        force: J^T W e, shape (logs, k).
    """
    matrix = np.einsum("bl,lij->bij", weights, slopes)
    matrix += np.diag(1e-9 * np.diag(slopes.sum(axis=0)) + 1e-12)
    return np.asarray(-np.linalg.solve(matrix, (weights @ force)[:, :, None])[:, :, 0])


def without_person(pepper: PepperModel, fit: Fit, person: str) -> JointResponse:
    """Return a response of all joints of a robot, fitted without the logs of a person.

    Args:
        pepper: The robot; joints that the logs lack have the response of `joint_response`.
        fit: The fit.
        person: One of `fit.persons`.

    Raises:
        UnknownNameError: for another person.
    """
    if person not in fit.without:
        raise UnknownNameError("person", person, tuple(fit.without))
    fitted, whole = fit.without[person], joint_response(pepper)
    return whole.changed(
        **{
            quantity: dict(zip(fitted.joint_names, getattr(fitted, quantity).tolist(), strict=True))
            for quantity in RESPONSE_QUANTITIES
        }
    )
