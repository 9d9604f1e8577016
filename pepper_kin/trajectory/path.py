"""The geometric path that a trajectory follows: piecewise cubic in a path parameter."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, FrozenArrays, PiecewiseCubic, read_only
from pepper_kin.core.splines import bounded_cubic_spline, cubic_spline, derivatives_on_segments
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_joint_vectors, check_within_limits

SAME = 1e-9  # distance up to which two waypoints are equal [rad or m]
LIMIT_TOLERANCE = 1e-9  # violation of position limits that is attributed to rounding [rad or m]
_ALONG = 1e-6  # maximum component across the path, relative to the velocity


@runtime_checkable
class PlannedPath(Protocol):
    """Result of planning, such as `pepper_kin.motion.Plan`: a curve, or None and the reason."""

    @property
    def success(self) -> bool:
        """Whether a path was found."""

    @property
    def curve(self) -> PiecewiseCubic | None:
        """The curve that was checked; None if there is none, or if the start equals the goal."""

    @property
    def message(self) -> str:
        """Result of planning, as a sentence."""

    @property
    def advice(self) -> str:
        """Advice on what to try, as a sentence."""


_ALLOWED = (
    "a plan, waypoints of shape (k, n), or a curve such as plan.curve; of other results their path, their "
    "trajectory, or their own retime()"
)

PathLike: TypeAlias = ArrayLike | PiecewiseCubic | PlannedPath


@dataclass(frozen=True, eq=False)
class CubicPath(FrozenArrays):
    """A continuous piecewise cubic curve of joint positions; arrays are read-only.

    Attributes:
        breaks: Ends of the pieces, increasing, shape (m + 1,).
        coefficients: Coefficients, constant term first, shape (m, 4, n).
    """

    breaks: Array
    coefficients: Array

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: for a wrong shape, NaN, breaks that do not increase, or segments with gaps.
        """
        breaks = read_only(as_finite(self.breaks, "breaks of the path", (None,)))
        if breaks.size < 2 or np.any(np.diff(breaks) <= 0):
            raise InvalidValueError(
                "breaks of the path", f"{breaks.size} numbers", "two or more increasing numbers"
            )
        shape = (breaks.size - 1, 4, None)
        coefficients = as_finite(self.coefficients, "coefficients of the path", shape)
        coefficients = read_only(np.ascontiguousarray(coefficients))
        object.__setattr__(self, "breaks", breaks)
        object.__setattr__(self, "coefficients", coefficients)
        ends = self.at(np.arange(breaks.size - 1), np.diff(breaks))
        gaps = np.abs(ends[:-1] - coefficients[1:, 0])
        if gaps.size and gaps.max() > 1e-6:
            at = int(np.argmax(gaps.max(axis=1)))
            raise InvalidValueError(
                "path",
                f"a jump of {gaps.max():.3g} at parameter {breaks[at + 1]:.6g}",
                "segments that meet",
            )

    def at(self, segment: ArrayLike, local: ArrayLike, derivative: int = 0) -> Array:
        """Return a derivative of q with respect to s on given pieces.

        Args:
            segment: Indices of pieces, shape (...).
            local: Value of s minus the piece's first break, shape (...).
            derivative: Order of the derivative, 0 to 3.

        Returns:
            Derivatives, shape (..., n).
        """
        return np.asarray(
            derivatives_on_segments(self.coefficients, segment, local, derivative + 1)[derivative]
        )

    def extremes(self) -> Array:
        """Return all positions where a joint may be extreme: ends of pieces, and dq/ds = 0, shape (k, n)."""
        h = np.diff(self.breaks)
        segment, _, local = turning_points(h, self.coefficients)
        last = self.at(np.array([h.size - 1]), h[-1:])
        return np.concatenate([self.coefficients[:, 0], last, self.at(segment, local)])


def turning_points(step: Array, coefficients: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Return where cubic pieces have dq/dt = 0 in their interior.

    Args:
        step: Lengths of the pieces, shape (m,).
        coefficients: Coefficients, constant term first, shape (m, 4, n).

    Returns:
        Indices of piece and joint, and the parameter since the piece's start, shape (k,) each.
    """
    a, b, c = (coefficients[:, p] * f for p, f in ((3, 3.0), (2, 2.0), (1, 1.0)))
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - 4 * a * c)
        # The stable pair of roots of a x^2 + b x + c; linear where a = 0.
        w = -(b + np.where(b >= 0, root, -root)) / 2
        found = np.stack([w / a, c / w])
        inside = (found > 0) & (found < step[:, None])  # False for NaN
    pair, segment, joint = np.nonzero(inside)
    return segment, joint, found[pair, segment, joint]


def as_cubic_path(
    pepper: PepperModel, path: PathLike, begin: tuple[Array, Array | None] | None = None
) -> CubicPath:
    """Return waypoints, a piecewise cubic curve or a plan as a `CubicPath` within the position limits.

    Waypoints are joined by a cubic spline with continuous second derivative over the chord length, with unit
    speed along the first and the last chord.  Between waypoints the spline leaves the polyline (two
    waypoints give the straight line); if that matters, give a curve that was checked, such as
    `pepper_kin.planners.smooth` returns.  A joint that the spline would move out of its limits although all
    waypoints are inside follows a monotone cubic spline instead (`_monotone`), which has no overshoot and
    passes waypoints with zero second derivative.

    With `begin`, a robot in motion can follow the spline: it starts in the direction of the velocity or, from
    rest, of the acceleration.  With both, its second derivative at the start is such that q' d2s/dt2 + q''
    (ds/dt)^2 is the acceleration; an additional knot in the first interval makes that possible.

    Args:
        pepper: The robot.
        path: Waypoints [rad or m], shape (k, n), k >= 2; an object with `breaks` and `coefficients` as
            in `PiecewiseCubic`; or a plan, whose curve is used.
        begin: Initial velocity [rad/s or m/s] and acceleration [rad/s^2 or m/s^2] for waypoints, shape (n,)
            each, at least one of them not zero; None for no acceleration, or for neither.

    Returns:
        The path.

    Raises:
        InvalidValueError: for one waypoint, equal successive waypoints, a start that equals the goal, NaN,
            or a wrong shape.
        LimitError: if the path leaves the position limits, naming the joint.
        InfeasibleError: for a plan that failed, with its reason.
    """
    if type(path) not in (np.ndarray, list, CubicPath) and is_plan(path):
        path = planned_curve(cast("PlannedPath", path))
    if type(path) is CubicPath:
        return path if _known_within.get(path) is pepper else _checked(pepper, path)
    if type(path) in (np.ndarray, list) or not isinstance(path, PiecewiseCubic):
        found = _quick_spline(pepper, path) if begin is None else None
        if found is not None:
            return found
        if not isinstance(path, (np.ndarray, list, tuple)) and np.asarray(path).dtype.kind == "O":
            if getattr(path, "success", None) is False:
                raise _failed(cast("PlannedPath", path))
            raise InvalidValueError("path", f"a {type(path).__name__}", _ALLOWED)
        points = _waypoints(pepper, path)
        if begin is not None:
            return _checked(pepper, _begun_spline(points, *begin))
        curve = _through_waypoints(pepper, points)
        check_within_limits(pepper, curve.extremes(), "path", LIMIT_TOLERANCE)
        return curve
    assert isinstance(path, PiecewiseCubic)
    degree = np.asarray(path.coefficients).shape[1:2]
    if degree != (4,):
        raise InvalidValueError(
            "path",
            f"segments of degree {degree[0] - 1}" if degree else "coefficients without segments",
            "cubic segments; of another trajectory its positions, such as trajectory.sample(0.05).position",
        )
    return _checked(pepper, CubicPath(path.breaks, path.coefficients))


def start_rates(curve: CubicPath, velocity: Array, acceleration: Array | None) -> tuple[float, float]:
    """Return ds/dt and d2s/dt2 with which a motion along a path begins.

    Args:
        curve: The path.
        velocity: Velocity at the start [rad/s or m/s], shape (n,).
        acceleration: Acceleration at the start [rad/s^2 or m/s^2], shape (n,); None for d2s/dt2 = 0.

    Raises:
        InvalidValueError: for a curve with another initial direction or curvature.
    """
    tangent, bend = curve.coefficients[0, 1], 2.0 * curve.coefficients[0, 2]
    square = max(float(tangent @ tangent), 1e-300)
    speed = float(velocity @ tangent) / square
    across = np.abs(velocity - speed * tangent).max() > _ALONG * np.abs(velocity).max()
    if speed < 0.0 or across:
        allowed = "a velocity along the beginning of the path; else motion.replan or Trajectory.replaced"
        raise InvalidValueError("start_velocity", np.array2string(velocity, precision=4), allowed)
    if acceleration is None:
        return speed, 0.0
    left = acceleration - bend * speed**2
    change = float(left @ tangent) / square
    if np.abs(left - change * tangent).max() > _ALONG * max(1.0, np.abs(acceleration).max()):
        allowed = "one that the path's curvature has at this velocity; else Trajectory.replaced"
        raise InvalidValueError("start_acceleration", np.array2string(acceleration, precision=4), allowed)
    return speed, change


def _begun_spline(points: Array, velocity: Array, acceleration: Array | None) -> CubicPath:
    """Return the spline through points, shape (k, n), with a given initial velocity and acceleration, (n,).

    The additional knot's point follows from the second derivative at the start, which is linear in it.
    """
    from scipy.interpolate import CubicSpline

    pushed = np.zeros_like(velocity) if acceleration is None else acceleration
    along, size = velocity if velocity.any() else pushed, float(np.linalg.norm(velocity))
    direction = along / np.linalg.norm(along)
    bent = size > 0.0 and acceleration is not None
    bend = (pushed - direction * (pushed @ direction)) / size**2 if bent else None
    chords = np.diff(points, axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    knots, last = np.append(0.0, np.cumsum(lengths)), (1, chords[-1] / lengths[-1])
    if bend is not None:
        knots = np.insert(knots, 1, knots[1] / 2)
        points = np.insert(points, 1, 0.0, axis=0)
        still = (1, np.zeros(1))
        effect = CubicSpline(knots, np.eye(knots.size)[:, 1:2], bc_type=(still, still)).c[1, 0]
        without = CubicSpline(knots, points, bc_type=((1, direction), last)).c[1, 0]
        points[1] = (bend / 2 - without) / effect
    spline = CubicSpline(knots, points, bc_type=((1, direction), last))
    return CubicPath(spline.x, np.moveaxis(spline.c[::-1], 0, 1))


def is_plan(path: object) -> bool:
    """Whether an object has the attributes of a `PlannedPath`; isinstance with the protocol is far slower."""
    return all(hasattr(path, name) for name in ("success", "curve", "message", "advice"))


def planned_curve(plan: PlannedPath) -> PiecewiseCubic:
    """Return a plan's curve.

    Raises:
        InfeasibleError: if planning failed, with the plan's reason.
        InvalidValueError: for a plan whose start equals its goal, or that is a trajectory already.
    """
    if not plan.success:
        raise _failed(plan)
    if plan.curve is None and getattr(plan, "trajectory", None) is not None:
        raise InvalidValueError("plan", "one that begins in motion", "its trajectory, which is timed")
    if plan.curve is None:
        raise InvalidValueError("plan", "a start that equals the goal", "a path longer than zero")
    return plan.curve


def _failed(plan: PlannedPath) -> InfeasibleError:
    """Return the error for a failed plan or other result, with its reason."""
    return InfeasibleError("trajectory", f"planning failed: {plan.message.rstrip('.')}", plan.advice)


def _checked(pepper: PepperModel, curve: CubicPath) -> CubicPath:
    if curve.coefficients.shape[2] != pepper.n:
        raise InvalidValueError("path", f"{curve.coefficients.shape[2]} joints", f"{pepper.n} joints")
    points = curve.extremes()
    if np.ptp(points, axis=0).max() <= SAME:
        raise InvalidValueError("path", "a path of zero length", "start and goal that differ")
    check_within_limits(pepper, points, "path", LIMIT_TOLERANCE)
    return curve


def _quick_spline(pepper: PepperModel, path: Any) -> CubicPath | None:
    """Return the spline through waypoints; None if they need closer checks or violate limits."""
    try:
        points = np.asarray(path)
        if (
            points.dtype.kind not in "fiu"
            or points.ndim != 2
            or points.shape[1] != pepper.n
            or len(points) < 2
        ):
            return None
        points = np.ascontiguousarray(points, dtype=float)
    except (TypeError, ValueError):
        return None
    breaks, coefficients = np.empty(len(points)), np.empty((len(points) - 1, 4, pepper.n))
    bounds = pepper.lower_limits, pepper.upper_limits
    violation = bounded_cubic_spline(points, *bounds, SAME, breaks, coefficients)
    return known_path(pepper, breaks, coefficients) if violation <= LIMIT_TOLERANCE else None


_known_within: WeakKeyDictionary[CubicPath, PepperModel] = WeakKeyDictionary()
"""Path -> robot whose position limits it is known to keep, with start and goal that differ."""


def known_path(pepper: PepperModel, breaks: Array, coefficients: Array) -> CubicPath:
    """Return the path of new arrays that are known to be valid, without copies and checks.

    The path is also known to keep the robot's position limits, so that they are not checked again.

    Args:
        pepper: The robot.
        breaks: Ends of the pieces, increasing, shape (m + 1,).
        coefficients: Coefficients, constant term first [rad or m], shape (m, 4, n).
    """
    path = object.__new__(CubicPath)
    breaks.setflags(write=False)
    coefficients.setflags(write=False)
    path.__dict__.update(breaks=breaks, coefficients=coefficients)
    _known_within[path] = pepper
    return path


def _waypoints(pepper: PepperModel, path: Any) -> Array:
    points = as_joint_vectors(pepper, path, "waypoints")
    if points.ndim != 2:
        raise InvalidValueError("waypoints", f"shape {points.shape}", f"shape (k, {pepper.n})")
    if len(points) < 2:
        raise InvalidValueError("waypoints", f"{len(points)} waypoint(s)", "at least 2")
    same = np.flatnonzero(np.linalg.norm(np.diff(points, axis=0), axis=1) <= SAME)
    if same.size and len(points) == 2:
        raise InvalidValueError("waypoints", "a start that equals the goal", "a path longer than zero")
    if same.size:
        raise InvalidValueError(
            "waypoints",
            f"rows {same[0]} and {same[0] + 1} are equal",
            "successive ones that differ: leave one out; for a pause, time the parts and join them by then()",
        )
    for index, point in enumerate(points):
        check_within_limits(pepper, point, f"waypoint {index}", LIMIT_TOLERANCE)
    return points


def _through_waypoints(pepper: PepperModel, points: Array) -> CubicPath:
    """Return the spline through waypoints [rad or m], shape (k, n), within the position limits."""
    s, segments = np.empty(len(points)), np.empty((len(points) - 1, 4, pepper.n))
    cubic_spline(np.ascontiguousarray(points), s, segments)
    curve, lengths = CubicPath(s, segments), np.diff(s)
    slopes = np.diff(points, axis=0) / lengths[:, None]
    extremes = curve.extremes()
    violation = np.maximum(pepper.lower_limits - extremes, extremes - pepper.upper_limits).max(axis=0)
    outside = violation > LIMIT_TOLERANCE
    if not outside.any():
        return curve
    thirds = (lengths[:, None] / 3 * np.arange(3)).ravel()
    segment = np.repeat(np.arange(lengths.size), 3)
    factorial = np.array([1.0, 1.0, 2.0, 6.0])
    coefficients = np.stack([curve.at(segment, thirds, d) / factorial[d] for d in range(4)], axis=1)
    coefficients[:, :, outside] = _monotone(lengths, slopes[:, outside])
    # Each piece begins where the previous one ends, exactly if a joint rests.
    coefficients[:, 0, outside] += np.repeat(points[:-1, outside], 3, axis=0)
    return CubicPath(np.append(s[segment] + thirds, s[-1]), coefficients)


def _monotone(lengths: Array, slopes: Array) -> Array:
    """Return monotone cubics with continuous second derivative, which is zero at each waypoint.

    The second derivative is linear between the ends and the thirds of a chord of slope c, where it is m1 and
    m2.  With first derivatives d0 and d1 at the ends, chord length h,
        m1 = (9 c - 6 d0 - 3 d1) / h,   m2 = (6 d1 + 3 d0 - 9 c) / h
    lead from one waypoint to the next.  The minimum of the first derivative is c (3 - (d0 + d1) / c), or its
    value (3 c - d) / 2 at a third, or d at an end: with 0 <= d0, d1 <= 3 c / 2 its sign never changes.
    Within that bound, d is the harmonic mean of the chords' slopes (Fritsch and Butland, 1984).

    Args:
        lengths: Lengths of the chords, shape (k,).
        slopes: Slopes of the joints along the chords, shape (k, n).

    Returns:
        Coefficients of three pieces for each chord relative to its first waypoint, shape (3 k, 4, n).
    """
    before, after = slopes[:-1], slopes[1:]
    both = np.where(before * after > 0, before + after, np.inf)
    mean = 2 * before * after / both
    least = np.minimum(np.abs(before), np.abs(after))
    inner = np.clip(mean, -1.5 * least, 1.5 * least)
    d = np.concatenate([slopes[:1], inner, slopes[-1:]])
    third = lengths[:, None] / 3
    d0, d1 = d[:-1], d[1:]
    bend = np.zeros((4, *slopes.shape))  # second derivative at ends and thirds
    bend[1] = (9 * slopes - 6 * d0 - 3 * d1) / (3 * third)
    bend[2] = (6 * d1 + 3 * d0 - 9 * slopes) / (3 * third)
    value, slope = np.zeros_like(slopes), d0
    segments = []
    for m0, m1 in itertools.pairwise(bend):
        cubic = (m1 - m0) / (6 * third)
        segments.append(np.stack([value, slope, m0 / 2, cubic], axis=1))
        value = value + third * (slope + third * (m0 / 2 + third * cubic))
        slope = slope + third * (m0 + m1) / 2
    return np.stack(segments, axis=1).reshape(-1, 4, slopes.shape[1])
