"""Names of the robot's animations -> gestures of this library."""

from __future__ import annotations

GESTURE_OF = {
    "hey": "wave",
    "hello": "wave",
    "hi_": "wave",
    "bye": "wave",
    "salute": "wave",
    "wave": "wave",
    "waving": "wave",
    "yes": "yes",
    "nod": "nod",
    "affirmative": "yes",
    "no_": "no",
    "nothing": "no",
    "negative": "no",
    "reject": "no",
    "desperate": "no",
    "never": "no",
    "dontknow": "shrug",
    "idontknow": "shrug",
    "shrug": "shrug",
    "confused": "shrug",
    "bow": "bow",
    "you": "you",
    "yourself": "you",
    "me_": "me",
    "myself": "me",
    "self": "me",
    "kisses": "me",
    "think": "think",
    "remember": "think",
    "hesitation": "think",
    "excited": "welcome",
    "enthusiastic": "welcome",
    "happy": "welcome",
    "joy": "welcome",
    "welcome": "welcome",
    "comeon": "welcome",
    "wings": "welcome",
    "applause": "clap",
    "clap": "clap",
    "give": "here-you-are",
    "take": "here-you-are",
    "please": "here-you-are",
    "offer": "here-you-are",
    "show": "point",
    "far": "point",
    "point": "point",
    "there": "point",
    "sky": "point",
    "floor": "point",
    "look": "look-around",
    "search": "look-around",
    "curious": "look-around",
    "dance": "sway",
    "music": "sway",
    "sway": "sway",
    "breath": "breathe",
    "idle": "breathe",
    "handshake": "handshake",
    "shakehand": "handshake",
    "but": "beat",
    "calmdown": "beat-both",
    "choice": "beat-twice",
    "great": "beat-both",
    "explain": "explain",
    "talk": "explain",
    "body language": "explain",
    "bodytalk": "explain",
}
"""Part of the name of an animation, or a tag -> the gesture of this library that comes nearest."""


def gesture_for(name: str) -> str:
    """Return the gesture that stands for an animation ("animations/Stand/Gestures/Hey_1").

    "explain" for others.
    """
    last = name.rstrip("/").split("/")[-1].lower() + "_"
    for part, gesture in GESTURE_OF.items():
        if last.startswith(part):
            return gesture
    for part, gesture in GESTURE_OF.items():
        if len(part) > 3 and part in last:
            return gesture
    return "explain"
