"""Scores of the gestures: joint positions over time.

Scores are written for the right side.  An arm is described by five angles [rad] with the same meaning on both
sides: upper arm lowered from the horizontal (negative: raised), upper arm held out, elbow pointing out, elbow
bent, and wrist rotated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

_ARM = (
    ("ShoulderPitch", 1.0),
    ("ShoulderRoll", -1.0),
    ("ElbowYaw", 1.0),
    ("ElbowRoll", 1.0),
    ("WristYaw", 1.0),
)


@dataclass(frozen=True)
class GestureKey:
    """Positions of some joints at one time.

    Attributes:
        time: Time at tempo 1 [s].
        joints: Joint -> position for the right side [rad]; other joints of the gesture pass without a key.
    """

    time: float
    joints: Mapping[str, float]


@dataclass(frozen=True)
class GestureScore:
    """One gesture, from the posture Stand and back to it.

    Attributes:
        says: Short description of the gesture.
        duration: Duration at tempo 1 [s].
        keys: Keys in order of time, all strictly between 0 and the duration.
    """

    says: str
    duration: float
    keys: tuple[GestureKey, ...]


def _arm(
    lowered: float, out: float, elbow_out: float, bend: float, wrist: float = 0.0, side: str = "R"
) -> dict[str, float]:
    sign = 1.0 if side == "R" else -1.0
    values = (lowered, out, elbow_out, bend, wrist)
    return {
        side + name: value * turn * (1.0 if name == "ShoulderPitch" else sign)
        for (name, turn), value in zip(_ARM, values, strict=True)
    }


def _arms(lowered: float, out: float, elbow_out: float, bend: float, wrist: float = 0.0) -> dict[str, float]:
    pose = (lowered, out, elbow_out, bend, wrist)
    return {**_arm(*pose), **_arm(*pose, side="L")}


def _head(yaw: float, pitch: float) -> dict[str, float]:
    return {"HeadYaw": yaw, "HeadPitch": pitch}


def _torso(knee: float, pitch: float, roll: float) -> dict[str, float]:
    return {"KneePitch": knee, "HipPitch": pitch, "HipRoll": roll}


def _score(says: str, duration: float, *keys: tuple[float, dict[str, float]]) -> GestureScore:
    return GestureScore(says, duration, tuple(GestureKey(time, joints) for time, joints in keys))


_FREE = {"LShoulderRoll": 0.22}  # keeps the resting arm away from the hip
_AHEAD = _head(0.0, -0.21)  # head position of the posture Stand

SCORES: dict[str, GestureScore] = {
    "wave": _score(
        "raises a hand and swings it from side to side",
        4.4,
        (0.9, {**_arm(-0.5, 0.35, 1.3, 1.15, -0.3), **_head(-0.15, -0.3)}),
        (1.4, _arm(-0.5, 0.75, 1.3, 0.75, -0.3)),
        (1.9, _arm(-0.5, 0.35, 1.3, 1.15, -0.3)),
        (2.4, _arm(-0.5, 0.75, 1.3, 0.75, -0.3)),
        (2.9, {**_arm(-0.5, 0.35, 1.3, 1.15, -0.3), **_head(-0.15, -0.3)}),
    ),
    "point": _score(
        "stretches an arm to the front and side, and looks along it",
        3.6,
        (1.1, {**_arm(0.25, 0.45, 1.2, 0.12, 0.6), **_head(-0.5, -0.15)}),
        (2.3, {**_arm(0.25, 0.45, 1.2, 0.12, 0.6), **_head(-0.5, -0.15)}),
    ),
    "you": _score(
        "offers an open hand to the one in front",
        3.0,
        (0.9, {**_arm(0.55, 0.2, 1.4, 0.45, 1.0), **_head(0.0, -0.28)}),
        (1.9, {**_arm(0.55, 0.2, 1.4, 0.45, 1.0), **_head(0.0, -0.28)}),
    ),
    "me": _score(
        "brings a hand to the chest and looks down at it",
        3.0,
        (0.9, {**_arm(0.95, 0.3, 1.35, 1.5, -0.6), **_head(-0.1, 0.0)}),
        (1.9, {**_arm(0.95, 0.3, 1.35, 1.5, -0.6), **_head(-0.1, 0.0)}),
    ),
    "here-you-are": _score(
        "holds out both hands, palms up, with a small bow",
        3.8,
        (1.2, {**_arms(0.85, 0.22, 1.45, 0.7, 1.2), **_torso(0.05, -0.16, 0.0), **_head(0.0, -0.05)}),
        (2.4, {**_arms(0.85, 0.22, 1.45, 0.7, 1.2), **_torso(0.05, -0.16, 0.0), **_head(0.0, -0.05)}),
    ),
    "handshake": _score(
        "offers a hand, shakes it twice, takes it back",
        5.0,
        (1.2, {**_arm(0.95, 0.2, 1.3, 0.45, 0.1), **_head(0.0, -0.15), **_torso(0.0, -0.1, 0.0), **_FREE}),
        (2.0, _arm(0.95, 0.2, 1.3, 0.45, 0.1)),
        (2.3, _arm(0.85, 0.2, 1.3, 0.62, 0.1)),
        (2.6, _arm(0.95, 0.2, 1.3, 0.45, 0.1)),
        (2.9, _arm(0.85, 0.2, 1.3, 0.62, 0.1)),
        (3.3, {**_arm(0.95, 0.2, 1.3, 0.45, 0.1), **_head(0.0, -0.15), **_torso(0.0, -0.1, 0.0), **_FREE}),
    ),
    "nod": _score(
        "nods once",
        1.6,
        (0.5, {"HeadPitch": 0.22}),
        (1.0, {"HeadPitch": -0.28}),
    ),
    "yes": _score(
        "nods twice, the second time less, with a beat of the hands",
        2.6,
        (0.5, {"HeadPitch": 0.25, **_arms(1.3, 0.3, 1.35, 0.85, 0.4)}),
        (0.9, {"HeadPitch": -0.28}),
        (1.3, {"HeadPitch": 0.15, **_arms(1.38, 0.28, 1.35, 0.75, 0.4)}),
        (1.8, {"HeadPitch": -0.24}),
    ),
    "shake-head": _score(
        "turns the head from side to side",
        2.4,
        (0.5, {"HeadYaw": -0.45}),
        (1.0, {"HeadYaw": 0.45}),
        (1.5, {"HeadYaw": -0.3}),
        (1.95, {"HeadYaw": 0.12}),
    ),
    "no": _score(
        "shakes the head and crosses the space before it with a hand",
        3.2,
        (0.7, {"HeadYaw": -0.4, **_arm(0.85, 0.3, 1.3, 1.1, -0.4)}),
        (1.2, {"HeadYaw": 0.4, **_arm(0.85, 0.65, 1.3, 0.85, -0.4)}),
        (1.7, {"HeadYaw": -0.35, **_arm(0.85, 0.3, 1.3, 1.1, -0.4)}),
        (2.2, {"HeadYaw": 0.15, **_arm(0.85, 0.65, 1.3, 0.85, -0.4)}),
    ),
    "bow": _score(
        "bends forward, arms a little away from the body",
        4.2,
        (0.7, _arms(1.58, 0.32, 1.22, 0.4)),
        (1.6, {**_torso(0.08, -0.45, 0.0), **_head(0.0, 0.2), **_arms(1.55, 0.36, 1.22, 0.4)}),
        (2.3, {**_torso(0.08, -0.45, 0.0), **_head(0.0, 0.2), **_arms(1.55, 0.36, 1.22, 0.4)}),
        (3.4, {**_torso(0.0, -0.03, 0.0), **_AHEAD, **_arms(1.58, 0.32, 1.22, 0.4)}),
    ),
    "shrug": _score(
        "lifts both forearms outwards and tilts the head",
        3.0,
        (0.8, {**_arms(1.25, 0.42, 1.7, 1.1, 1.2), **_head(-0.2, -0.3), **_torso(0.0, 0.04, 0.0)}),
        (1.7, {**_arms(1.2, 0.48, 1.75, 1.15, 1.3), **_head(-0.22, -0.32), **_torso(0.0, 0.04, 0.0)}),
    ),
    "explain": _score(
        "opens the hands one after the other, as one does while talking",
        6.0,
        (1.0, {**_arm(0.95, 0.3, 1.4, 0.95, 0.6), **_head(-0.12, -0.24)}),
        (1.7, _arm(1.05, 0.5, 1.5, 0.75, 1.0)),
        (2.0, {**_arm(1.2, 0.25, 1.4, 0.9, -0.6, side="L"), **_head(0.12, -0.2)}),
        (2.8, _arm(0.95, 0.4, 1.5, 0.9, -1.0, side="L")),
        (3.4, {**_arms(1.0, 0.45, 1.5, 0.8, 0.9), **_head(0.0, -0.26)}),
        (4.4, {**_arms(1.1, 0.35, 1.4, 0.9, 0.5), **_AHEAD}),
    ),
    "beat": _score(
        "marks a word with one short stroke of a hand",
        1.8,
        (0.55, _arm(1.05, 0.28, 1.35, 1.05, 0.3)),
        (0.85, _arm(1.22, 0.28, 1.35, 0.72, 0.3)),
        (1.15, _arm(1.15, 0.28, 1.35, 0.82, 0.3)),
    ),
    "beat-twice": _score(
        "marks two words with strokes of a hand",
        2.5,
        (0.55, _arm(1.05, 0.3, 1.35, 1.05, 0.5)),
        (0.85, _arm(1.22, 0.3, 1.35, 0.72, 0.5)),
        (1.25, _arm(1.05, 0.42, 1.4, 1.0, 0.7)),
        (1.6, _arm(1.2, 0.42, 1.4, 0.72, 0.7)),
    ),
    "beat-both": _score(
        "marks a word with both hands",
        2.0,
        (0.6, {**_arms(1.05, 0.3, 1.4, 1.0, 0.5), "HeadPitch": -0.26}),
        (0.95, {**_arms(1.22, 0.34, 1.4, 0.7, 0.7), "HeadPitch": -0.15}),
        (1.3, _arms(1.18, 0.34, 1.4, 0.76, 0.7)),
    ),
    "welcome": _score(
        "opens both arms wide",
        4.2,
        (1.3, {**_arms(0.85, 0.7, 1.5, 0.5, 1.0), **_head(0.0, -0.3), **_torso(0.0, -0.06, 0.0)}),
        (2.6, {**_arms(0.9, 0.75, 1.5, 0.5, 1.0), **_head(0.0, -0.3), **_torso(0.0, -0.06, 0.0)}),
    ),
    "clap": _score(
        "brings the forearms together before the chest three times, without touching",
        4.4,
        (1.0, _arms(0.75, 0.34, 1.3, 0.95, -0.3)),
        (1.3, _arms(0.75, 0.15, 1.2, 0.95, -0.3)),
        (1.6, _arms(0.75, 0.34, 1.3, 0.95, -0.3)),
        (1.9, _arms(0.75, 0.15, 1.2, 0.95, -0.3)),
        (2.2, _arms(0.75, 0.34, 1.3, 0.95, -0.3)),
        (2.5, _arms(0.75, 0.15, 1.2, 0.95, -0.3)),
        (2.9, _arms(0.8, 0.34, 1.3, 0.9, -0.3)),
    ),
    "think": _score(
        "lifts a hand towards the chin and looks up and away",
        4.6,
        (1.2, {**_arm(0.35, 0.3, 1.25, 1.45, -0.5), **_head(0.4, -0.42), **_torso(0.0, 0.0, 0.03), **_FREE}),
        (2.2, {**_arm(0.32, 0.3, 1.25, 1.42, -0.4), **_head(0.45, -0.45), **_torso(0.0, 0.0, 0.03)}),
        (3.2, {**_arm(0.35, 0.3, 1.25, 1.45, -0.5), **_head(0.3, -0.38), **_torso(0.0, 0.0, 0.03), **_FREE}),
    ),
    "look-around": _score(
        "looks to one side, to the other, and back",
        5.2,
        (1.1, _head(-0.9, -0.2)),
        (1.7, _head(-0.95, -0.12)),
        (3.0, _head(0.9, -0.22)),
        (3.7, _head(0.95, -0.12)),
    ),
    "breathe": _score(
        "breathes twice; made for standing idly",
        8.0,
        (1.6, {**_torso(0.0, 0.02, 0.0), "HeadPitch": -0.25, **_arms(1.55, 0.17, 1.22, 0.55)}),
        (4.0, {**_torso(0.0, -0.026, 0.0), "HeadPitch": -0.21, **_arms(1.58, 0.125, 1.22, 0.52)}),
        (5.6, {**_torso(0.0, 0.02, 0.0), "HeadPitch": -0.25, **_arms(1.55, 0.17, 1.22, 0.55)}),
    ),
    "sway": _score(
        "sways from side to side with both arms, as if to music",
        6.4,
        (0.8, {**_arms(1.1, 0.45, 1.4, 0.95), **_torso(0.0, -0.02, 0.0), **_AHEAD}),
        (1.6, {"HipRoll": 0.1, "HeadYaw": 0.2, "RShoulderRoll": -0.6, "LShoulderRoll": 0.4}),
        (2.6, {"HipRoll": -0.1, "HeadYaw": -0.2, "RShoulderRoll": -0.4, "LShoulderRoll": 0.6}),
        (3.6, {"HipRoll": 0.1, "HeadYaw": 0.2, "RShoulderRoll": -0.6, "LShoulderRoll": 0.4}),
        (4.6, {"HipRoll": -0.1, "HeadYaw": -0.2, "RShoulderRoll": -0.4, "LShoulderRoll": 0.6}),
        (5.4, {**_arms(1.1, 0.45, 1.4, 0.95), **_torso(0.0, -0.02, 0.0), **_AHEAD}),
    ),
}  # fmt: skip
"""Name of a gesture -> its score."""
