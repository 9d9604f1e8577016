"""Coupling of mimic joints to coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel


def coupling_of(pepper: PepperModel, joint: str) -> tuple[str, float, float]:
    """Return the coordinate that a moving joint follows (itself, if it has one), its gain and its offset.

    Chains of followers are resolved: position = gain * coordinate + offset.
    """
    row = list(pepper.inner_model.names).index(joint) - 1
    column = int(np.argmax(np.abs(pepper.full_map[row])))
    gain, offset = pepper.full_map[row, column], pepper.full_offset[row]
    return pepper.joint_names[column], float(gain), float(offset)


def leader_of(pepper: PepperModel, joint: str) -> str:
    """Return the coordinate that a moving joint follows; itself, if it has one."""
    return coupling_of(pepper, joint)[0]
