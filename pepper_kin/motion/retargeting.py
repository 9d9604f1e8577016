"""Retargeting of a person's motion, given by key points over time, to a robot with arms like Pepper's."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision import Scene, in_collision
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.core.inverse_kinematics.local_solver import MOST_NEAR
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.ik.collisions import Collisions
from pepper_kin.kernels.interrupts import interrupt_table
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.model.requirements import ROBOT
from pepper_kin.motion.key_points import KeyPoints
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.enforce_limits import Slowed, rounded_and_slowed
from pepper_kin.trajectory.limits import motion_limits

if TYPE_CHECKING:
    from pepper_kin.trajectory import Certificate

SIDES = ("left", "right")
LIMBS = ("left_upper_arm", "left_forearm", "right_upper_arm", "right_forearm")

PERIOD = 0.02
"""Time between computed frames [s]."""

STEADIED, LEVER = 0.15, 0.5
"""Averaging time of angles of limbs along their axis [s], and sine between them that ends averaging."""

CALM = 0.08
"""Additional averaging time of head and torso, as a standard deviation [s]."""

FIRM, FITS = (0.0, 10.0, 30.0), 10
"""Successive weights of distance shortages [1/m], and number of Gauss-Newton steps with each."""

ROUNDS, REFITS, MOST_FIRM = 12, 4, 64.0
"""Rounds of further steps that double the weights at contacts, steps of a round, and maximum factor."""

DAMPING, LONGEST = 1e-3, 0.3
"""Damping of the steps, and largest step of a joint [rad]."""

MU, UNSEEN = 0.12, 0.05
"""Error that an acceleration at its limit counts as [rad], and weight of a limb that is not observed."""

CLIPPED = math.radians(5.0)
"""Error from which on a limb counts as clipped [rad]."""

_ROUNDS, _BACK, _SPREAD = 24, 0.12, 0.12
"""Rounds that move arms in contact back, fraction of the way to Stand in each, and spread in time [s]."""

FINE = 4
"""Number of points of the curve for each frame that are checked for contact."""

_SEEN = 0.1
"""Minimum fraction of the frames in which a point is observed."""


class RetargetStatus(ResultStatus):
    """Status of retargeting."""

    DONE = "done", "Execute `trajectory`; `report()` says what was slowed or left out."
    NOT_SEEN = "not_seen", "Give points that are seen more often, or a shorter part of the recording."
    IN_COLLISION = "in_collision", "Move the obstacle, or give a shorter part of the recording."
    NOT_HELD = "not_held", "Leave out the torso with torso=False, or take a load away."


@dataclass(frozen=True, eq=False)
class Retargeted(FrozenArrays):
    """The robot's version of a person's motion, and its deviations.

    Attributes:
        status: Status of the result.
        message: What happened, in a sentence with numbers.
        trajectory: The motion within all limits, from rest to rest; None if there is none.
        certificate: Certificate of `trajectory.check`; None if there is no motion.
        times: Times of the frames in the recording, from 0, every 20 ms [s], shape (F,).
        errors: Angle between each of `LIMBS` and the person's limb [rad], shape (F, 4); NaN if not observed.
        speed: Speed of the motion relative to the person's at each frame, at most 1, shape (F,).
        moved: How far left and right arm were moved back from contact, 0 to 1 (as in Stand), shape (F, 2).
        filled: Fraction of the arms' points that was not observed.
        time: Wall time [s].
    """

    status: RetargetStatus
    message: str
    trajectory: Trajectory | None = None
    certificate: Certificate | None = field(default=None, repr=False)
    times: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    errors: Array = field(default_factory=lambda: np.zeros((0, 4)), repr=False)
    speed: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    moved: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    filled: float = 0.0
    time: float = 0.0

    @property
    def success(self) -> bool:
        """Whether there is a motion."""
        return self.status is RetargetStatus.DONE

    @property
    def advice(self) -> str:
        """Advice on what to do next, as a sentence."""
        return self.status.advice

    @property
    def clipped(self) -> np.ndarray:
        """Whether each limb is more than 5 degrees off at each frame, shape (F, 4)."""
        return np.asarray(self.errors > CLIPPED)

    def report(self) -> str:
        """Return the result in plain words: deviations from the person's motion, where, and how much."""
        lines = [self.message]
        for k, limb in enumerate(LIMBS):
            if self.errors.size and np.isfinite(self.errors[:, k]).any():
                half, most = np.nanmedian(self.errors[:, k]), np.nanmax(self.errors[:, k])
                lines.append(
                    f"{limb.replace('_', ' ')}: {math.degrees(half):.1f} degrees off on the median, "
                    f"{math.degrees(most):.1f} at most" + self._spans(self.clipped[:, k], "; over 5 from ")
                )
        for k, side in enumerate(SIDES[: self.moved.shape[1]]):
            if self.moved.size and self.moved[:, k].max() > 0:
                lines.append(
                    f"{side} arm: moved clear of contact" + self._spans(self.moved[:, k] > 0.01, " from ")
                )
        if self.speed.size and self.speed.min() < 0.99:
            slow = self._spans(self.speed < 0.99, " from ")
            lines.append(f"slowed down to {self.speed.min():.2f} of the person's speed at least{slow}")
        if self.filled > 0:
            lines.append(f"{100 * self.filled:.1f} % of the arms' points were not seen, and filled in")
        return "\n".join([*lines, self.advice])

    def _spans(self, there: np.ndarray, word: str) -> str:
        """Return the first time intervals in which a condition holds, in words; empty for none."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
        spans = [
            f"{self.times[begin]:.2f} to {self.times[end - 1]:.2f} s"
            for begin, end in zip(edges[::2], edges[1::2], strict=True)
        ]
        more = f" and {len(spans) - 3} more" if len(spans) > 3 else ""
        return word + ", ".join(spans[:3]) + more if spans else ""


def retarget(
    pepper: PepperModel,
    points: KeyPoints | ArrayLike,
    times: ArrayLike | None = None,
    names: Any = None,
    *,
    up: ArrayLike = (0.0, 0.0, 1.0),
    smoothing: float = 0.04,
    torso: bool = True,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
) -> Retargeted:
    """Move the robot as a person moves: arms, head and, if hips are observed, the torso's lean.

    Directions count, not positions, so that the person's size does not matter.  The robot's limbs take the
    directions in its torso that the person's limbs have in the trunk (y from shoulder to shoulder, z along
    the trunk): in closed form, then by least squares over all frames at once, with small accelerations,
    within limits and clear of near bodies.  Arms still in contact are moved towards Stand until they are
    clear.  The result is smoothed, and slowed down where velocity, acceleration, torque or balance require it
    (`trajectory.enforce_limits`).  The person's heading is ignored: the base stands still.

    Args:
        pepper: The robot.
        points: The person as `KeyPoints`, or positions, shape (T, K, 3), NaN if not observed, in any unit.
            Shoulders, elbows and wrists are required; hips (else the trunk is upright), nose and ears, or
            nose or head and neck (else the head rests) are used.
        times: Times of the frames [s], shape (T,), or a frame rate [1/s]; not with `KeyPoints`.
        names: Names of the points, or "coco", "human36m" or "mediapipe"; not with `KeyPoints`.
        up: Upward direction in the frame of the points, shape (3,); (0, -1, 0) for most cameras.
        smoothing: Standard deviation of the points' moving average in time [s]; 0 for none.
        torso: Whether the torso leans with the trunk.
        scene: The world around the robot; the robot also avoids itself.
        payload: Point masses held at "left", "right" or a frame by name [kg].

    Returns:
        The motion, with its certificate, or the reason.

    Raises:
        InvalidValueError: for invalid points or times, or an `up` of length zero.
        UnknownNameError: if a required point is missing, or for a robot without Pepper's arms.
    """
    begin = time.perf_counter()
    if not isinstance(points, KeyPoints):
        if times is None or names is None:
            raise InvalidValueError("times and names", "None", "times and names of the points, or KeyPoints")
        points = KeyPoints(times, points, names)
    world = checked_world(scene) or Scene()
    window = 0.0 if smoothing == 0 else check_positive("smoothing", smoothing, "s")
    vertical = np.asarray(up, dtype=float)
    if vertical.shape != (3,) or not np.isfinite(vertical).all() or not np.linalg.norm(vertical) > 0:
        raise InvalidValueError("up", up, "a direction, shape (3,), not zero")
    for name in (f"{side}_{part}" for side in SIDES for part in ("shoulder", "elbow", "wrist")):
        share = float(np.isfinite(points.of(name)).all(axis=1).mean())
        if share < _SEEN or share * len(points) < 2:
            message = f"{name} is seen in {100 * share:.0f} % of the frames, {100 * _SEEN:.0f} % are needed"
            return Retargeted(RetargetStatus.NOT_SEEN, message, time=time.perf_counter() - begin)
    person = _person(points, vertical / np.linalg.norm(vertical), window)
    asked = _fitted(pepper, person, _first_guess(pepper, person, lean=torso), world)
    q, moved = _moved_clear(pepper, asked, world)
    if q is None:
        at = float(person.times[int(np.argmax(moved.max(axis=1)))])
        message = f"the robot touches something about {at:.2f} s, also with its arms as in Stand"
        return Retargeted(RetargetStatus.IN_COLLISION, message, time=time.perf_counter() - begin)
    return _timed(pepper, person, q, moved, world, payload, begin)


class Person(NamedTuple):
    """A person's motion every PERIOD, with unobserved points filled in.

    Attributes:
        times: Times from 0 [s], shape (F,).
        limbs: Directions of `LIMBS` in the trunk, unit vectors, shape (F, 4, 3).
        seen: Whether each limb was observed, shape (F, 4).
        lean: Pitch and roll of the trunk [rad], shape (F, 2).
        head: Yaw and pitch of the head in the trunk [rad], shape (F, 2).
        filled: Fraction of the arms' points that was not observed.
    """

    times: Array
    limbs: Array
    seen: np.ndarray
    lean: Array
    head: Array
    filled: float


def _person(points: KeyPoints, up: Array, window: float) -> Person:
    """Return a person's motion; `up`, shape (3,), is a unit vector, `window` a standard deviation [s]."""
    from scipy.ndimage import gaussian_filter1d

    span = float(points.times[-1] - points.times[0])
    grid = np.linspace(0.0, span, max(round(span / PERIOD), 3) + 1)
    place = {name: _at_times(points, name, grid, window) for name in points.names}

    def unit(vectors: Any) -> Array:
        return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))

    shoulders = 0.5 * (place["left_shoulder"] + place["right_shoulder"])
    hips = points.has("left_hip", "right_hip") and bool(
        np.isfinite(place["left_hip"] + place["right_hip"]).all()
    )
    trunk = (
        shoulders - 0.5 * (place["left_hip"] + place["right_hip"]) if hips else np.tile(up, (grid.size, 1))
    )
    y = unit(place["left_shoulder"] - place["right_shoulder"])
    x = unit(np.cross(y, trunk))
    z = np.cross(x, y)
    frame = np.stack([x, y, z], axis=1)  # rows: from the world to the trunk
    limbs, seen = [], []
    for limb in LIMBS:
        side, _, part = limb.partition("_")
        ends = (
            (f"{side}_shoulder", f"{side}_elbow")
            if part == "upper_arm"
            else (f"{side}_elbow", f"{side}_wrist")
        )
        limbs.append(np.einsum("fij,fj->fi", frame, unit(place[ends[1]] - place[ends[0]])))
        there = np.isfinite(points.of(ends[0])).all(axis=1) & np.isfinite(points.of(ends[1])).all(axis=1)
        nearest = np.clip(np.searchsorted(points.times - points.times[0], grid - 1e-9), 0, len(points) - 1)
        seen.append(np.asarray(there)[nearest] & np.asarray(there)[np.maximum(nearest - 1, 0)])
    upright = frame @ up
    # For R = Ry(pitch) Rx(roll): R^T e_z = (-sin pitch, sin roll cos pitch, cos roll cos pitch).
    pitch, roll = np.arcsin(np.clip(-upright[:, 0], -1, 1)), np.arctan2(upright[:, 1], upright[:, 2])
    parts = [f"{side}_{part}" for side in SIDES for part in ("shoulder", "elbow", "wrist")]
    filled = float(np.mean([~np.isfinite(points.of(name)).all(axis=1) for name in parts]))
    lean, head = (
        gaussian_filter1d(angles, CALM / (grid[1] - grid[0]), axis=0, mode="nearest")
        for angles in (np.stack([pitch, roll], axis=1), _head(place, frame))
    )
    return Person(grid, np.stack(limbs, axis=1), np.stack(seen, axis=1), lean, head, filled)


def _at_times(points: KeyPoints, name: str, grid: Array, window: float) -> Array:
    """Return a point at times [s], shape (F, 3), interpolated linearly over gaps and averaged over time."""
    from scipy.ndimage import gaussian_filter1d

    place, clock = points.of(name), points.times - points.times[0]
    there = np.isfinite(place).all(axis=1)
    if there.sum() < 2:
        return np.full((grid.size, 3), np.nan)
    found = np.stack([np.interp(grid, clock[there], place[there, i]) for i in range(3)], axis=1)
    if window > 0:
        found = gaussian_filter1d(found, window / (grid[1] - grid[0]), axis=0, mode="nearest")
    return np.asarray(found)


def _head(place: dict[str, Array], frame: Array) -> Array:
    """Return yaw and pitch of the head [rad], shape (F, 2), from points and trunk axes at all frames."""

    def of(*names: str) -> Array | None:
        found = [place[name] for name in names if name in place and np.isfinite(place[name]).all()]
        return sum(found) / len(found) if len(found) == len(names) else None  # type: ignore[return-value]

    nose, ears = of("nose"), of("left_ear", "right_ear")
    neck = of("neck") if "neck" in place else of("left_shoulder", "right_shoulder")
    if nose is not None and ears is not None:
        ahead = np.einsum("fij,fj->fi", frame, nose - ears)
        pitch = np.arctan2(-ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))
        return np.stack([np.arctan2(ahead[:, 1], ahead[:, 0]), pitch], axis=1)
    top = of("head")
    if top is None or neck is None:
        return np.zeros((len(frame), 2))
    upward = np.einsum("fij,fj->fi", frame, top - neck)
    return np.stack([np.zeros(len(frame)), np.arctan2(upward[:, 0], upward[:, 2])], axis=1)


def _first_guess(pepper: PepperModel, person: Person, *, lean: bool) -> Array:
    """Return approximate joint positions of the person's motion, within limits [rad], shape (F, n)."""
    q = np.tile(pepper.posture("Stand"), (person.times.size, 1))
    column, period = {name: k for k, name in enumerate(pepper.joint_names)}, float(person.times[1])
    q[:, column["HeadYaw"]], q[:, column["HeadPitch"]] = person.head.T
    if lean:
        turned = [
            frame_pose(pepper, pepper.joint_vector({"KneePitch": 0.0, name: 0.5}), "torso")
            for name in ("HipPitch", "HipRoll")
        ]
        # The hip's axes may point opposite to the torso's axes.
        q[:, column["HipPitch"]] = math.copysign(1.0, turned[0][0, 2]) * person.lean[:, 0]
        q[:, column["HipRoll"]] = math.copysign(1.0, turned[1][2, 1]) * person.lean[:, 1]
        q[:, column["KneePitch"]] = 0.0
    for k, (side, letter) in enumerate(zip(SIDES, "LR", strict=True)):
        upper, fore = person.limbs[:, 2 * k], person.limbs[:, 2 * k + 1]
        sign = 1.0 if side == "left" else -1.0
        roll = np.arcsin(np.clip(upper[:, 1], -1, 1))
        pitch = _steadied(np.arctan2(-upper[:, 2], upper[:, 0]), np.cos(roll), period)
        c, s, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
        # The forearm in the axes of the upper arm: Rz(-roll) Ry(-pitch).
        ahead, down = c * fore[:, 0] - s * fore[:, 2], s * fore[:, 0] + c * fore[:, 2]
        along, across = cr * ahead + sr * fore[:, 1], cr * fore[:, 1] - sr * ahead
        bend = np.arccos(np.clip(along, -1, 1))
        yaw = _steadied(np.arctan2(-sign * down, -sign * across), np.sin(bend), period)
        q[:, column[f"{letter}ShoulderPitch"]], q[:, column[f"{letter}ShoulderRoll"]] = pitch, roll
        q[:, column[f"{letter}ElbowYaw"]], q[:, column[f"{letter}ElbowRoll"]] = yaw, -sign * bend
    return np.clip(q, pepper.lower_limits, pepper.upper_limits)


class _Near:
    """Distances of bodies near one another, and their gradients.

    Args:
        pepper: The robot.
        scene: The world around the robot.
    """

    def __init__(self, pepper: PepperModel, scene: Scene) -> None:
        self._around, self._signals = Collisions(pepper, scene), interrupt_table()
        self._tests = self._around.tests(self._signals)
        four = [ctypes.c_int64] * 4
        self._call = ctypes.CFUNCTYPE(ctypes.c_int64, *four)(self._tests.near)
        self._rows = np.empty((MOST_NEAR, pepper.n + 2))

    def at(self, q: Array) -> Array:
        """Return gradients and shortages of pairs that are too near, shape (k, n + 1), at q, shape (n,)."""
        q = np.ascontiguousarray(q)
        count = self._call(q.ctypes.data, self._rows.ctypes.data, MOST_NEAR, self._tests.near_memory)
        return self._rows[:count, :-1].copy()


def _fitted(pepper: PepperModel, person: Person, q: Array, scene: Scene) -> Array:
    """Return joint positions of all frames that give the limbs' directions with small accelerations.

    Over the arms' joints of all frames, within their limits, the sum
        sum_f sum_k w_fk^2 |u_k(q_f) - d_fk|^2 + sum_fj (mu q''_fj / a_j)^2 + sum_fp (c s_fp)^2
    is minimized, with directions u_k and the person's d_k, accelerations q'' by second differences relative
    to their limits a, and distance shortages s_p between near bodies; by damped Gauss-Newton steps, in which
    joints stay at limits that the gradient pushes against (Bertsekas, Projected Newton methods for
    optimization problems with simple constraints, 1982).  The matrix is banded: each frame is coupled with
    the two before.

    Args:
        pepper: The robot.
        person: The person's motion.
        q: Initial joint positions within the limits [rad], shape (F, n).
        scene: The world to avoid.
    """
    from scipy.linalg import solveh_banded

    arms = np.array([pepper.joint_index(f"{letter}{part}") for letter in "LR" for part in _ARM])
    low, high, count, m = pepper.lower_limits[arms], pepper.upper_limits[arms], len(q), len(arms)
    period, near = float(person.times[1]), _Near(pepper, scene)
    share = (MU / (pepper.acceleration_limits[arms] * period**2)) ** 2
    weight = np.where(person.seen, 1.0, UNSEEN) ** 2
    weights = np.repeat(FIRM, FITS)
    firm = np.ones(count)
    for step in range(len(weights) + ROUNDS * REFITS):
        if step >= len(weights) and (step - len(weights)) % REFITS == 0:
            touching = np.flatnonzero(in_collision(pepper, _rounded(q), scene))
            if not touching.size:
                break
            hit = np.zeros(count, dtype=bool)
            for back in range(-1, 3):
                hit[np.clip(touching // FINE + back, 0, count - 1)] = True
            firm[hit] = np.minimum(2.0 * firm[hit], MOST_FIRM)
        matrix, slope = _of_limbs(pepper, person, weight, q, arms)
        push = (weights[min(step, len(weights) - 1)] * firm) ** 2
        for f in range(count):
            for row in near.at(q[f]) if push[f] > 0 else ():
                part = row[arms]
                matrix[f] += push[f] * np.outer(part, part)
                slope[f] -= push[f] * row[-1] * part
        x = q[:, arms]
        bends = np.diff(np.concatenate([x[:1], x, x[-1:]]), 2, axis=0) * share  # at rest before and after
        slope += np.diff(np.concatenate([bends[:1], bends, bends[-1:]]), 2, axis=0)
        rests = ((x <= low + 1e-9) & (slope > 0)) | ((x >= high - 1e-9) & (slope < 0))
        band = _band(matrix + DAMPING * np.eye(m), share, rests)
        change = solveh_banded(band, np.where(rests, 0.0, -slope).ravel()).reshape(count, m)
        q[:, arms] = np.clip(x + np.clip(change, -LONGEST, LONGEST), low, high)
    return q


def _of_limbs(
    pepper: PepperModel, person: Person, weight: Array, q: Array, arms: np.ndarray
) -> tuple[Array, Array]:
    """Return matrix, shape (F, m, m), and gradient, shape (F, m), of the limbs' part of `_fitted`'s cost.

    Args:
        pepper: The robot.
        person: The person's motion.
        weight: Squared weights w^2 of the limbs, shape (F, 4).
        q: Joint positions [rad], shape (F, n).
        arms: Indices of the arms' joints, shape (m,).
    """
    matrix, slope = np.zeros((len(q), arms.size, arms.size)), np.zeros((len(q), arms.size))
    torso = frame_pose(pepper, q, "torso")[:, :3, :3]
    for k, (frame, axis) in enumerate(_limb_axes(pepper)):
        along = frame_pose(pepper, q, frame)[:, :3, :3] @ axis
        turning = frame_jacobian(pepper, q, frame)[:, 3:][:, :, arms]
        jacobian = np.cross(turning, along[:, :, None], axis=1)
        residual = along - np.einsum("fij,fj->fi", torso, person.limbs[:, k])
        matrix += weight[:, k, None, None] * np.einsum("fci,fcj->fij", jacobian, jacobian)
        slope += weight[:, k, None] * np.einsum("fci,fc->fi", jacobian, residual)
    return matrix, slope


def _band(matrix: Array, share: Array, rests: np.ndarray) -> Array:
    """Return the upper band of the matrix of `_fitted` in the form of `scipy.linalg.solveh_banded`.

    Args:
        matrix: Diagonal block of each frame, shape (F, m, m).
        share: Weight of the squared second differences of each joint, shape (m,).
        rests: Whether each joint stays at its limit, shape (F, m).
    """
    count, m = rests.shape
    band = np.zeros((2 * m + 1, count, m))
    for i in range(m):
        for j in range(i, m):
            band[2 * m - (j - i), :, j] += matrix[:, i, j]
    pattern = np.zeros((3, count))  # D^T D of second differences: its diagonal and two off-diagonals
    pattern[0], pattern[1, 1:], pattern[2, 2:] = 6.0, -4.0, 1.0
    pattern[0, [0, -1]], pattern[1, [1, -1]] = 2.0, -3.0
    for back in range(3):
        band[2 * m - back * m] += pattern[back][:, None] * share
    flat, still = band.reshape(2 * m + 1, count * m), rests.ravel()
    for back in range(1, 2 * m + 1):  # element (i, j), j = i + back, stands in column j
        flat[2 * m - back, back:][still[back:] | still[:-back]] = 0.0
    flat[2 * m, still] = 1.0
    return flat


def _steadied(angle: Array, lever: Array, period: float) -> Array:
    """Return an angle [rad], shape (F,), averaged over time where it hardly moves its limb.

    Args:
        angle: Angle about an axis [rad], shape (F,); the limb points away from the axis by asin(lever).
        lever: Sine of the angle between limb and axis, 0 to 1, shape (F,).
        period: Time between two frames [s].
    """
    from scipy.ndimage import gaussian_filter1d

    whole, weight = np.unwrap(angle), lever**2 + 1e-6
    width = STEADIED / period
    average = gaussian_filter1d(whole * weight, width, mode="nearest") / gaussian_filter1d(
        weight, width, mode="nearest"
    )
    share = np.clip(lever / LEVER, 0.0, 1.0) ** 2
    return np.asarray((share * whole + (1.0 - share) * average + math.pi) % (2.0 * math.pi) - math.pi)


_ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll")


def _limb_axes(pepper: PepperModel) -> list[tuple[str, Array]]:
    """Return the frame that carries each of `LIMBS`, and the limb's direction in it, shape (3,)."""
    q, found = pepper.neutral(), []
    for side in "LR":
        for frame, end in ((f"{side}Bicep", f"{side}Elbow"), (f"{side}ForeArm", f"{side.lower()}_wrist")):
            pose = frame_pose(pepper, q, frame)
            axis = pose[:3, :3].T @ (frame_pose(pepper, q, end)[:3, 3] - pose[:3, 3])
            found.append((frame, axis / np.linalg.norm(axis)))
    return found


def limb_directions(pepper: PepperModel, q: ArrayLike) -> Array:
    """Return directions of `LIMBS` in the torso, shape (..., 4, 3), at q, shape (..., n) [rad]."""
    torso = frame_pose(pepper, q, "torso")[..., :3, :3]
    ends = [frame_pose(pepper, q, frame)[..., :3, :3] @ axis for frame, axis in _limb_axes(pepper)]
    return np.asarray(np.einsum("...ij,...ki->...kj", torso, np.stack(ends, axis=-2)))


def _rounded(q: Array) -> Array:
    """Return samples of the cubic B-spline of points, (F, n), FINE for each frame, (FINE (F - 1) + 1, n)."""
    four = np.concatenate([q[:1], q, q[-1:], q[-1:]])
    u = (np.arange(FINE) / FINE)[:, None]
    basis = np.hstack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3]) / 6
    windows = np.stack([four[i : len(q) + i] for i in range(4)])
    fine = np.einsum("ui,ifn->fun", basis, windows).reshape(-1, q.shape[1])
    return np.asarray(fine[: FINE * (len(q) - 1) + 1])


def _moved_clear(pepper: PepperModel, asked: Array, scene: Scene) -> tuple[Array | None, Array]:
    """Return joint positions [rad], shape (F, n), with arms in contact moved back, and by how much, (F, 2).

    The positions are None if the contact cannot be removed.
    """
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    stand, back = pepper.posture("Stand"), np.zeros((len(asked), 2))
    arms = [np.array([name.startswith(s) and name[1:] in _ARM for name in pepper.joint_names]) for s in "LR"]
    width = round(_SPREAD / PERIOD)

    def blended(part: Array) -> Array:
        q = asked.copy()
        for k, arm in enumerate(arms):
            q[:, arm] += part[:, k, None] * (stand[arm] - q[:, arm])
        return q

    q = asked
    for _ in range(_ROUNDS):
        path = _rounded(q)
        at = np.flatnonzero(in_collision(pepper, path, scene))
        if not at.size:
            return q, back
        for k in range(2):
            alone = path[at].copy()
            alone[:, arms[1 - k]] = stand[arms[1 - k]]
            touching = at[in_collision(pepper, alone, scene)]
            both = at if k == 0 else at[:0]
            hit = np.zeros(len(asked), dtype=bool)
            hit[np.minimum((touching if touching.size else both) // FINE, len(asked) - 1)] = True
            near = maximum_filter1d(hit.astype(float), 2 * width + 1)
            back[:, k] = np.minimum(
                back[:, k] + _BACK * gaussian_filter1d(near, width / 2.0, mode="nearest"), 1.0
            )
            back[hit, k] = np.minimum(back[hit, k] + 0.02, 1.0)
        q = blended(back)
    return None, back


def _timed(
    pepper: PepperModel,
    person: Person,
    q: Array,
    moved: Array,
    scene: Scene,
    payload: Mapping[str, float] | None,
    begin: float,
) -> Retargeted:
    """Return the result with the motion through joint positions q [rad], shape (F, n), within all limits."""
    raw = Trajectory.from_positions(pepper, person.times, q, interpolation="monotone")
    period = float(person.times[1])
    try:
        kept = motion_limits(pepper, balance=ROBOT, torque_scale=ROBOT, payload=payload, scene=scene)
        slowed: Slowed = rounded_and_slowed(pepper, raw, period, kept)
    except InfeasibleError as error:
        return Retargeted(RetargetStatus.NOT_HELD, str(error), time=time.perf_counter() - begin)
    certificate = slowed.trajectory.check(pepper, scene, payload=payload)
    # The curve begins one period before the person's first frame.
    attained = limb_directions(pepper, slowed.curve(person.times + period).position)
    cosine = np.clip(np.sum(attained * person.limbs, axis=2), -1.0, 1.0)
    errors = np.where(person.seen, np.arccos(cosine), np.nan)
    speed = np.interp(person.times + period, slowed.time, slowed.speed)
    duration, given = slowed.trajectory.duration, float(person.times[-1])
    message = f"{given:.2f} s of motion take {duration:.2f} s"
    status = RetargetStatus.DONE
    if not certificate.success:
        status = (
            RetargetStatus.IN_COLLISION
            if {"self_clearance", "obstacle_clearance"} & set(certificate.failures)
            else RetargetStatus.NOT_HELD
        )
        message += f"; the check fails: {', '.join(certificate.failures)}"
    return Retargeted(
        status,
        message,
        slowed.trajectory if certificate.success else None,
        certificate,
        read_only(person.times),
        read_only(errors),
        read_only(np.minimum(speed, 1.0)),
        read_only(moved),
        person.filled,
        time.perf_counter() - begin,
    )
