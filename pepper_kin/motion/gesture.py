"""Authored gestures, timed within the robot's limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_choice
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.motion.gesture_scores import SCORES, GestureScore
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.enforce_limits import enforce_limits

SIDES = ("right", "left")
LARGEST_AMPLITUDE = 1.25
TEMPOS = (0.25, 4.0)
_REST = "Stand"
_SAME = 1e-6  # largest distance of the start from that posture [rad]
# Joints whose sign stays the same when mirrored; all others change sign.
_STRAIGHT = ("KneePitch", "HipPitch", "HeadPitch", "LShoulderPitch", "RShoulderPitch")


def gesture_names() -> tuple[str, ...]:
    """Return the names of all gestures, in the library's order."""
    return tuple(SCORES)


def gesture_meaning(name: str) -> str:
    """Return a short description of a gesture.

    Raises:
        UnknownNameError: for another name.
    """
    return _score(name).says


def gesture(
    pepper: PepperModel,
    name: str,
    *,
    side: str = "right",
    amplitude: float = 1.0,
    tempo: float = 1.0,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    start: ArrayLike | None = None,
) -> Trajectory:
    """Return a gesture of the library, from the posture Stand and back to it.

    The keys of each joint are joined by a monotone cubic (PCHIP: no overshoot between keys); the motion is
    smoothed, and slowed down where limits require it, by `pepper_kin.trajectory.enforce_limits`.

    Args:
        pepper: Pepper, with any base and any hands; joints that the gesture does not name rest.
        name: Name of the gesture, one of `gesture_names()`.
        side: "right" or "left": the hand that acts, and the side to which head and torso turn first.
        amplitude: Factor on the authored displacement from the posture Stand, in (0, 1.25].
        tempo: Speed relative to the authored one, in [0.25, 4]; limits may make it slower.
        scene: The scene whose attached objects count with their mass, as in `enforce_limits`.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement, None to leave balance out.
        torque_scale: Fraction of the effort limits to use, in (0, 1]; "robot" for the robot's requirement.
        start: First and last configuration [rad or m], shape (n,), such as the end of a drive: the posture
            Stand, with the base anywhere; with the base at zero if omitted.

    Returns:
        The timed gesture.

    Raises:
        UnknownNameError: for an unknown gesture, or a robot without Pepper's joints.
        InvalidValueError: for a side, amplitude or tempo out of range, or a start in another posture.
        InfeasibleError: if the robot could not hold a posture of the gesture.
    """
    score = _score(name)
    check_choice("side", side, SIDES)
    _check_between("amplitude", amplitude, 0.0, LARGEST_AMPLITUDE)
    _check_between("tempo", tempo, *TEMPOS)
    rest = _rest(pepper, start)
    motion = _authored(pepper, score, rest, side, float(amplitude), float(tempo))
    return enforce_limits(
        pepper, motion, scene=scene, payload=payload, balance=balance, torque_scale=torque_scale
    )


def _score(name: str) -> GestureScore:
    if name not in SCORES:
        raise UnknownNameError("gesture", name, SCORES)
    return SCORES[name]


def _check_between(quantity: str, value: float, low: float, high: float) -> None:
    number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not (number and np.isfinite(value) and low <= value <= high and value > 0):
        above = "above 0" if low == 0.0 else f"at least {low:g}"
        raise InvalidValueError(quantity, repr(value), f"a number {above} and at most {high:g}")


def _rest(pepper: PepperModel, start: ArrayLike | None) -> Array:
    """Return the posture in which a gesture begins [rad or m], shape (n,).

    Raises:
        InvalidValueError: if the start is another posture, naming the joint.
    """
    rest = pepper.posture(_REST)
    if start is None:
        return rest
    given = as_joint_vector(pepper, start, "start")
    off = np.where(np.isin(pepper.joint_names, BASE_JOINTS), 0.0, np.abs(given - rest))
    j = int(np.argmax(off))
    if off[j] > _SAME:
        allowed = f"the posture {_REST}, {rest[j]:.6g} rad; only the base may be elsewhere"
        raise InvalidValueError("start", f"{pepper.joint_names[j]} at {given[j]:.6g} rad", allowed)
    return np.array(given)


def _authored(
    pepper: PepperModel, score: GestureScore, rest: Array, side: str, amplitude: float, tempo: float
) -> Trajectory:
    """Return the curves through the keys, before smoothing and slowing down."""
    from scipy.interpolate import PchipInterpolator

    named = dict.fromkeys(joint for key in score.keys for joint in key.joints)
    times = np.array([0.0, *(key.time for key in score.keys), score.duration])
    coefficients = np.zeros((times.size - 1, 4, pepper.n))
    coefficients[:, 0] = rest
    for joint in named:
        keys = [(key.time, key.joints[joint]) for key in score.keys if joint in key.joints]
        mirrored, sign = (joint, 1.0) if side == "right" else _mirror(joint)
        j = pepper.joint_index(mirrored)
        # Equal keys before the start and after the end make the curve begin and end at rest.
        time = [-1.0, 0.0, *(t for t, _ in keys), score.duration, score.duration + 1.0]
        way = [0.0, 0.0, *(amplitude * (sign * value - rest[j]) for _, value in keys), 0.0, 0.0]
        curve = PchipInterpolator(time, rest[j] + np.array(way))
        for power, divisor in enumerate((1.0, 1.0, 2.0, 6.0)):
            # Derivatives from the right, inside each piece: at a key the second derivative jumps.
            derivative = curve.derivative(power) if power else curve
            coefficients[:, power, j] = derivative(times[:-1]) / divisor
    scale = tempo ** np.arange(4)
    return Trajectory(pepper.joint_names, times / tempo, coefficients * scale[:, None], pepper.joint_units)


def _mirror(joint: str) -> tuple[str, float]:
    """Return the joint on the other side and the sign of its position there."""
    swapped = {"L": "R", "R": "L"}
    other = swapped[joint[0]] + joint[1:] if joint[0] in swapped else joint
    return other, 1.0 if joint in _STRAIGHT else -1.0
