"""Motion bounds of the whole body for one radian of each joint."""

from __future__ import annotations

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.motion_tree import bounds_anywhere
from pepper_kin.model import PepperModel, kept_for_robot


@kept_for_robot(most=32)
def frame_motion_bounds(pepper: PepperModel) -> Array:
    """Return R, shape (n,) [m/rad or 1]: no point of the body moves by more than sum_i R_i |dq_i|."""
    return read_only(bounds_anywhere(pepper))
