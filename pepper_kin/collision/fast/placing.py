"""Machine code that places all bodies of a robot at once, for eight configurations at a time.

It is straight-line code for one robot: frames whose rotations map axes to axes cost no products.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.core.collision.records import LANE_POSE
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.kernels.lanes import LANES
from pepper_kin.model import PepperModel, RobotMemory, robot_digest
from pepper_kin.symbolic.poses import world_poses
from pepper_kin.symbolic.states import new_state

if TYPE_CHECKING:
    import casadi

SHARE = 0.5
"""Minimum ratio of moving bodies at which this kernel is faster."""
NUMBERS = LANE_POSE.width // LANES
"""Size of a body's pose: rotation row by row, then origin."""

_kept: RobotMemory[None, Kernel] = RobotMemory()


def placing_kernel(pepper: PepperModel) -> Kernel:
    """Return the kernel from a configuration, shape (n,) [rad or m], to the poses of all bodies.

    Its `block` reads coordinates and writes rows of LANE_POSE as `check_block` stores them.
    """
    kept = _kept.of(pepper)
    if None not in kept:
        sources = source_digest("pepper_kin.symbolic", "pepper_kin.model", __name__)
        kept[None] = compile_function(
            lambda: _poses(pepper),
            dtype="float32",
            key=f"placing of {robot_digest(pepper)} by {sources}",
            vector_bytes=4 * LANES,
            batch=False,
        )
    return kept[None]


def _poses(pepper: PepperModel) -> casadi.Function:
    """Return the expression of all bodies' poses."""
    state, symbols = new_state(pepper, "q")
    rows = [(x,) for turn, origin in world_poses(state) for row in (*turn, origin) for x in row]
    return symbols.function("body_poses", poses=rows)
