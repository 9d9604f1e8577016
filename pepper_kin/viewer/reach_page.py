"""The page of a reach: the executed motion with its targets and scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.viewer.drawable import Color
from pepper_kin.viewer.viewer import Viewer

if TYPE_CHECKING:
    from pepper_kin.jobs import ReachOutcome

_GAZE_COLOR: Color = (0.12, 0.44, 0.92, 1.0)


def save_reach_html(pepper: PepperModel, outcome: ReachOutcome, path: str | Path) -> Path:
    """Save a page that plays the twin's motion, with targets, obstacles and the torque of each joint.

    Args:
        pepper: Model of the robot.
        outcome: Outcome of an executed reach.
        path: File to write; it appears when it is complete.

    Returns:
        The path of the file.

    Raises:
        InvalidValueError: The outcome holds no run.
        FileFormatError: A mesh of the robot cannot be read, or the path cannot be written.
    """
    if outcome.run is None:
        raise InvalidValueError("outcome", "a reach without a run", "a reach that was executed")
    viewer = Viewer(pepper).add_scene(outcome.scene).add_target(f"{outcome.hand} hand", outcome.target)
    if outcome.gaze is not None:
        viewer.add_target("gaze", outcome.gaze, _GAZE_COLOR)
    return viewer.save_html(
        path, outcome.run, title=f"{pepper.name.title()} reaches with the {outcome.hand} hand"
    )
