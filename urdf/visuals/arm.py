"""The left arm down to the wrist; the right one is its mirror image."""

from __future__ import annotations

import numpy as np

from .decals import Projector, Relief, band, spot
from .loft import Loft
from .measurements import link_shape
from .part import Part, measured_loft
from .solids import ellipsoid


def shoulder() -> list[Part]:
    """Return the visuals of both shoulders: a ball cut flat above and below, turning about its axis z."""
    low, high = link_shape("LShoulder").bounds[:, 2]
    radius = link_shape("LShoulder").bounds[1, 0]
    s = np.linspace(low, high, 13)
    across = np.sqrt(radius**2 - s**2)
    rows = np.column_stack([s, 0.0 * s, 0.0 * s, across, across, np.full_like(s, 2.0)])
    ball = Loft("z", rows, low, high, (False, False), (0.003, 0.003))
    return [Part("shoulder_ball", "pepper_gray", ball.mesh(36, 10))]


def left_bicep() -> list[Part]:
    """Return the visuals of `LBicep`."""
    surface = measured_loft("LBicep")
    cuff = band(surface, 0.1385, 0.1485, relief=Relief(0.0006, 0.0006, edge=4.0), segments=40)
    return [
        Part("left_bicep_shell", "pepper_white", surface.mesh(38, 19)),
        Part("left_bicep_cuff", "pepper_light_gray", cuff),
    ]


def elbow() -> list[Part]:
    """Return the visuals of both elbows: a dark ball."""
    radius = link_shape("LElbow").bounds[1, 0]
    return [Part("elbow_ball", "pepper_dark", ellipsoid(np.zeros(3), np.full(3, radius), "z").mesh(34, 16))]


def left_forearm() -> list[Part]:
    """Return the visuals of `LForeArm`."""
    surface = measured_loft("LForeArm", round_ends=(True, False), fillets=(0.0, 0.002))
    cuff = band(surface, 0.034, 0.040, relief=Relief(0.0005, 0.0005, edge=4.0), segments=40)
    return [
        Part("left_forearm_shell", "pepper_white", surface.mesh(38, 11)),
        Part("left_forearm_cuff", "pepper_light_gray", cuff),
    ]


def left_wrist() -> list[Part]:
    """Return the visuals of `l_wrist`: the second half of the forearm and the palm."""
    surface = measured_loft("l_wrist", round_ends=(False, True), fillets=(0.002, 0.0))
    ring = band(surface, -0.0600, -0.0565, relief=Relief(0.0004, 0.0004), segments=40)
    touch = spot(
        surface,
        Projector(np.array([0.048, 0.0, 0.010]), np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])),
        (0.017, 0.021),
    )
    palm = spot(
        surface,
        Projector(np.array([0.046, -0.002, 0.004]), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])),
        (0.030, 0.024),
        rings=3,
        exponent=2.5,
    )
    return [
        Part("left_hand_shell", "pepper_white", surface.mesh(36, 22)),
        Part("left_hand_ring", "pepper_light_gray", ring),
        Part("left_hand_touch", "pepper_light_gray", touch),
        Part("left_hand_palm", "pepper_light_gray", palm),
    ]


def phalanx() -> list[Part]:
    """Return the visuals of the first and middle phalanges."""
    return [Part("phalanx", "pepper_light_gray", measured_loft("phalanx").mesh(18, 11))]


def fingertip() -> list[Part]:
    """Return the visuals of the last phalanges."""
    return [Part("fingertip", "pepper_light_gray", measured_loft("fingertip").mesh(18, 11))]
