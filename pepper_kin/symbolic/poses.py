"""Poses of frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.states import StateExpressions, new_state
from pepper_kin.symbolic.vectors import IDENTITY, ZERO, Matrix, Vector, add, product, times

if TYPE_CHECKING:
    import casadi


def frame_pose(pepper: PepperModel, frame: str) -> casadi.Function:
    """Return the function q -> pose of a link or sensor frame.

    Args:
        pepper: The robot.
        frame: Name of a frame, see `pepper.frame_names`.

    Returns:
        Function of q (n) [rad or m]; output `pose` (4, 4) is transform_frame_to_world [m].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """
    return _frame_poses(pepper, (frame,), "frame_pose", "pose")


def frame_poses(pepper: PepperModel, frames: Sequence[str]) -> casadi.Function:
    """Return the function q -> poses of several frames.

    Args:
        pepper: The robot.
        frames: Names of k frames, see `pepper.frame_names`.

    Returns:
        Function of q (n) [rad or m]; output `poses` (4 k, 4) stacks transform_frame_to_world of all frames
        [m].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: for no frame.
    """
    if not frames:
        raise InvalidValueError("frames", frames, "at least one name")
    return _frame_poses(pepper, tuple(frames), "frame_poses", "poses")


@remembered
def _frame_poses(pepper: PepperModel, frames: tuple[str, ...], name: str, output: str) -> casadi.Function:
    """Return the shorter of the functions for compact and for plain body frames."""
    candidates = []
    for compact in (True, False):
        state, symbols = new_state(pepper, "q", compact=compact)
        rows = []
        for rotation, position in world_frames(state, frames):
            rows += [(*turn, x) for turn, x in zip(rotation, position, strict=True)]
            rows.append((0.0, 0.0, 0.0, 1.0))
        candidates.append(symbols.function(name, **{output: rows}))
    return min(candidates, key=lambda function: int(function.n_instructions()))


def world_poses(state: StateExpressions) -> list[tuple[Matrix, Vector]]:
    """Return the orientation and the origin of every body in the world."""
    poses: list[tuple[Matrix, Vector]] = []
    for body, turn, r in zip(state.tree.bodies, state.turns, state.translations, strict=True):
        rotation, position = poses[body.parent] if body.parent >= 0 else (IDENTITY, ZERO)
        poses.append((turn.compose(rotation), add(position, times(rotation, r))))
    return poses


def world_frames(state: StateExpressions, frames: Sequence[str]) -> list[tuple[Matrix, Vector]]:
    """Return the orientation and the origin of frames in the world."""
    poses = world_poses(state)
    result = []
    for frame in frames:
        body, rotation, translation = state.tree.anchor(frame)
        turn, position = poses[body] if body >= 0 else (IDENTITY, ZERO)
        result.append((product(turn, rotation), add(position, times(turn, translation))))
    return result
