"""Examination of a motion against the scene at all times."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.examination import Examiner, hull_of
from pepper_kin.trajectory import Trajectory


def is_clear_along(
    checks: Checks,
    motion: Trajectory,
    margins: tuple[float, float] = (0.0, 0.0),
    *,
    held: bool = False,
    strictly: bool = False,
) -> bool:
    """Whether margins are kept anywhere along a cubic motion; see `Examiner.is_clear`.

    Args:
        checks: The robot in its scene.
        motion: The motion.
        margins: To the scene and to the robot itself [m].
        held: Whether to ask if the joints can hold still along it.
        strictly: Whether the margin to the scene is proven to be kept at every point.
    """
    things = tuple((item.frame, item.extent) for item in checks.exact.scene.attached.values())
    reach = motion_bounds(checks.pepper, held=things)
    if not np.isfinite(reach).all():
        reach = motion_bounds(checks.pepper, *hull_of(motion.breaks, motion.coefficients), things)
    moving = np.flatnonzero((motion.coefficients[:, 1:] != 0.0).any(axis=(0, 1)))
    examiner = Examiner(checks, motion.coefficients[0, 0].copy(), moving)
    arguments = motion.breaks, motion.coefficients, reach, margins
    return examiner.is_clear(*arguments, held=held, strictly=strictly)
