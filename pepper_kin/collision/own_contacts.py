"""Pairs of a robot's own links that touch in every posture, which its SRDF has to disable."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.checker import checker_for
from pepper_kin.model import PepperModel, kept_for_robot

_POSTURES = 32
_WIDEST = np.pi  # range of joints without limits [rad or m]
_LISTED = 3


@kept_for_robot()
def always_touching(pepper: PepperModel) -> tuple[tuple[str, str], ...]:
    """Return the pairs of links that touch in the neutral posture and in 32 random, reproducible ones."""
    checker, random = checker_for(pepper), np.random.default_rng(0)
    lower, upper = np.maximum(pepper.lower_limits, -_WIDEST), np.minimum(pepper.upper_limits, _WIDEST)
    found = dict.fromkeys(checker.contacts(pepper.neutral()))
    for _ in range(_POSTURES):
        if not found:
            break
        touching = set(checker.contacts(random.uniform(lower, upper)))
        found = {pair: None for pair in found if pair in touching}
    return tuple(found)


def advice_on_own_links(pepper: PepperModel, names: tuple[str, str] | None = None) -> str:
    """Return advice if two of the robot's own links touch in every posture; else an empty text.

    Args:
        pepper: The robot.
        names: Names of two links that touch; None for any.
    """
    pairs = always_touching(pepper)
    if not pairs or (names is not None and names not in pairs):
        return ""
    listed = ", ".join(" and ".join(pair) for pair in pairs[:_LISTED])
    more = f" and {len(pairs) - _LISTED} more pairs" if len(pairs) > _LISTED else ""
    return (
        f"these are its own links, which touch in every posture ({listed}{more}): disable such pairs in an "
        "SRDF, see 'Other robots' in docs/description.md"
    )
