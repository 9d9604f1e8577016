"""The torso with its tablet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.urdf.looks.decals import Projector, Relief, band, ring, spot
from pepper_kin.urdf.looks.loft import Loft
from pepper_kin.urdf.looks.measurements import features
from pepper_kin.urdf.looks.mesh import Mesh, join
from pepper_kin.urdf.looks.part import Part, measured_loft
from pepper_kin.urdf.looks.solids import drum

Array = NDArray[np.float64]

_SHOULDER = np.array([-0.057, 0.14974, 0.22582])
_SOCKET_WALL, _SOCKET_INNER, _SOCKET_OUTER = 0.112, 0.047, 0.058


def _sockets(points: Array) -> Array:
    """Press flat shoulder sockets into the sides: |y| is limited near the shoulder axis, smoothly beyond it."""
    carved = points.copy()
    distance = np.hypot(points[..., 0] - _SHOULDER[0], points[..., 2] - _SHOULDER[2])
    way = np.clip((distance - _SOCKET_INNER) / (_SOCKET_OUTER - _SOCKET_INNER), 0.0, 1.0)
    free = way * way * (3.0 - 2.0 * way)
    width = np.abs(points[..., 1])
    limited = np.minimum(width, _SOCKET_WALL)
    carved[..., 1] = np.sign(points[..., 1]) * (limited + free * (width - limited))
    return carved


def body() -> Loft:
    """Return the torso's surface without the tablet."""
    return replace(measured_loft("torso", round_ends=(False, True), fillets=(0.004, 0.0)), carve=_sockets)


def _tablet() -> list[Part]:
    """Return frame, screen and back of the tablet, tilted so that its screen looks up at people."""
    facts = features()["tablet"]
    thick, wide, high = facts["size_thickness_width_height"]
    pitch = np.radians(facts["pitch_deg"])
    front = 0.5 * thick
    c, s = np.cos(pitch), np.sin(pitch)
    rotation, centre = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.array(facts["centre"])
    low, top = np.array(facts["screen_bounds"])
    screen_half = (0.5 * (top - low)[1], 0.5 * (top - low)[2] / c)
    screen_up = (0.5 * (low + top) - centre)[2] / c - front * np.tan(-pitch)
    frame = drum(
        "x", [0, 0, 0], (0.5 * wide, 0.5 * high), (front - 0.016, front - 0.0006), fillets=(0.006, 0.004), exponent=7.0
    )
    rows = [[-front, 0.0, -0.01, 0.050, 0.042, 3.0], [0.0, 0.0, -0.006, 0.066, 0.054, 3.5]]
    rows.append([front - 0.014, 0.0, 0.0, 0.098, 0.074, 4.5])
    back = Loft("x", np.array(rows), -front, front - 0.014, (False, False))
    lens = Projector(np.array([front - 0.01, 0.0, screen_up]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    glass = spot(frame, lens, screen_half, relief=Relief(0.0006, 0.0002, edge=12.0), exponent=12.0, segments=64)
    placed: list[tuple[str, str, Mesh]] = [
        ("tablet_frame", "pepper_light_grey", frame.mesh(64, 8)),
        ("tablet_back", "pepper_white", back.mesh(40, 4)),
        ("tablet_screen", "pepper_screen", glass),
    ]
    return [Part(name, material, mesh.transformed(rotation, centre)) for name, material, mesh in placed]


def torso() -> list[Part]:
    """Return the visuals of `torso`."""
    surface = body()
    side = Projector.toward([_SHOULDER[0], 0.0, _SHOULDER[2]], [0.0, 1.0, 0.0])
    socket = spot(surface, side, (0.045, 0.045), relief=Relief(0.0008, 0.0008))
    rim = ring(surface, side, (0.062, 0.062), 0.010, relief=Relief(0.0008, 0.0008, edge=4.0), segments=56)
    collar = band(surface, 0.2955, 0.3015, relief=Relief(0.0006, 0.0006, edge=4.0))
    return [
        Part("torso_shell", "pepper_white", surface.mesh(64, 36)),
        Part("torso_sockets", "pepper_dark", join([socket, socket.mirrored()])),
        Part("torso_socket_rims", "pepper_light_grey", join([rim, rim.mirrored()])),
        Part("torso_collar", "pepper_light_grey", collar),
        *_tablet(),
    ]
