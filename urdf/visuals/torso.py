"""The torso with its tablet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .decals import Projector, Relief, band, spot
from .loft import Loft
from .measurements import features
from .mesh import Mesh, join
from .part import Part, measured_loft
from .solids import drum
from .stitching import hoop

Array = NDArray[np.float64]

_SHOULDER = np.array([-0.057, 0.14974, 0.22582])
_SHELL_HALF_WIDTH = 0.125
_RING_RADII = (0.066, 0.0645, 0.061, 0.056, 0.051, 0.0475, 0.0455)
_RING_RISE = (0.0, 0.45, 0.85, 1.0, 0.95, 0.75, 0.2)
_RING_FOOT, _RING_HEIGHT, _RING_WING = 0.100, 0.028, 0.014


def body() -> Loft:
    """Return the torso's white surface, without shoulder rings and tablet."""
    measured = measured_loft("torso", round_ends=(False, True), fillets=(0.004, 0.0))
    rows = measured.sections.copy()
    rows[:, 4] = np.minimum(rows[:, 4], _SHELL_HALF_WIDTH)
    return replace(measured, sections=rows)


def _shoulder_ring(segments: int = 44) -> Mesh:
    """Return the left shoulder's ring, higher behind and above, where the arm never passes."""
    angle = np.arange(segments) * (2.0 * np.pi / segments)
    # Counter-clockwise seen from the left (+y): from z toward x.
    radii, rise = np.array(_RING_RADII)[::-1, None], np.array(_RING_RISE)[::-1, None]
    wing = np.clip(np.cos(angle - np.radians(-40.0)), 0.0, 1.0) ** 2
    outer = np.empty((len(radii), segments, 3))
    outer[..., 0] = _SHOULDER[0] + radii * np.sin(angle)
    outer[..., 2] = _SHOULDER[2] + radii * np.cos(angle)
    outer[..., 1] = _RING_FOOT + rise * (_RING_HEIGHT + _RING_WING * wing)
    inner = outer.copy()
    inner[..., 1] = _RING_FOOT - 0.01
    return hoop(outer, inner)


def _tablet() -> list[Part]:
    """Return frame, screen and back of the tablet, tilted so that its screen looks up at people."""
    facts = features()["tablet"]
    thick, wide, high = facts["size_thickness_width_height"]
    pitch = np.radians(facts["pitch_deg"])
    front = 0.5 * thick
    c, s = np.cos(pitch), np.sin(pitch)
    rotation, center = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.array(facts["center"])
    low, top = np.array(facts["screen_bounds"])
    screen_half = (0.5 * (top - low)[1], 0.5 * (top - low)[2] / c)
    screen_up = (0.5 * (low + top) - center)[2] / c - front * np.tan(-pitch)
    frame = drum(
        "x",
        [0, 0, 0],
        (0.5 * wide, 0.5 * high),
        (front - 0.016, front - 0.0006),
        fillets=(0.006, 0.004),
        exponent=7.0,
    )
    rows = [[-front, 0.0, -0.01, 0.050, 0.042, 3.0], [0.0, 0.0, -0.006, 0.066, 0.054, 3.5]]
    rows.append([front - 0.014, 0.0, 0.0, 0.098, 0.074, 4.5])
    back = Loft("x", np.array(rows), -front, front - 0.014, (False, False))
    lens = Projector(
        np.array([front - 0.01, 0.0, screen_up]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    )
    glass = spot(
        frame, lens, screen_half, relief=Relief(0.0008, 0.0012, edge=16.0), exponent=9.0, segments=64
    )
    placed: list[tuple[str, str, Mesh]] = [
        ("tablet_frame", "pepper_light_gray", frame.mesh(64, 8)),
        ("tablet_back", "pepper_white", back.mesh(40, 4)),
        ("tablet_screen", "pepper_screen", glass),
    ]
    return [Part(name, material, mesh.transformed(rotation, center)) for name, material, mesh in placed]


def torso() -> list[Part]:
    """Return the visuals of `torso`."""
    surface = body()
    ring = _shoulder_ring()
    side = Projector.toward([_SHOULDER[0], 0.0, _SHOULDER[2]], [0.0, 1.0, 0.0])
    socket = spot(surface, side, (0.0475, 0.0475), relief=Relief(0.0008, -0.0004))
    collar = band(surface, 0.2955, 0.3015, relief=Relief(0.0006, 0.0006, edge=4.0))
    return [
        Part("torso_shell", "pepper_white", surface.mesh(60, 30)),
        Part("torso_sockets", "pepper_dark", join([socket, socket.mirrored()])),
        Part("torso_shoulder_rings", "pepper_light_gray", join([ring, ring.mirrored()])),
        Part("torso_collar", "pepper_light_gray", collar),
        *_tablet(),
    ]
