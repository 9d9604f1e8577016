"""A robot and its surroundings in an open `meshcat.Visualizer`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_positive, shown
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.drawing import draw_commands, link_path
from pepper_kin.viewer.joint_motion import Playable, joint_motion
from pepper_kin.viewer.motion_frames import kept_samples


@dataclass(frozen=True)
class _Command:
    """A command for a `meshcat` window to send."""

    content: dict[str, Any]

    def lower(self) -> dict[str, Any]:
        """Return the content of the command."""
        return self.content


class MeshcatScene:
    """A drawing of `Viewer.in_meshcat`, in which `display` and `play` move the robot.

    Args:
        visualizer: `meshcat.Visualizer`, or a part of one.
        pepper: Model of the robot.
        drawn: Drawables of the robot and its surroundings.
        links: Links with drawables.

    Raises:
        InvalidValueError: for an object that is no visualizer.
    """

    def __init__(
        self, visualizer: Any, pepper: PepperModel, drawn: Iterable[Drawable], links: tuple[str, ...]
    ) -> None:
        if not (hasattr(visualizer, "window") and hasattr(visualizer, "path")):
            raise InvalidValueError("visualizer", shown(visualizer), "a meshcat.Visualizer")
        self._visualizer, self._pepper, self._links = visualizer, pepper, links
        root = visualizer.path.lower()
        visualizer.delete()
        for command in draw_commands(drawn):
            visualizer.window.send(_Command({**command, "path": root + command["path"]}))
        self.display(pepper.default_posture())

    def display(self, q: ArrayLike) -> None:
        """Show joint positions [rad or m], shape (n,), as Pinocchio's `MeshcatVisualizer.display`.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        state = as_joint_vector(self._pepper, q, "q")
        for link, pose in zip(self._links, frame_poses(self._pepper, state, self._links), strict=True):
            self._part(link).set_transform(pose)

    def play(self, motion: Playable, *, fps: float = 40.0, repetitions: int = 1) -> None:
        """Play a motion in the browser by meshcat's animation, which has a slider; return at once.

        Args:
            motion: Motion: a trajectory, a run of the twin, or a `JointMotion`.
            fps: Maximum frames per second.
            repetitions: Number of repetitions.

        Raises:
            InvalidValueError: for a motion of another robot, or one that tilts.
        """
        from meshcat.animation import Animation

        chosen = joint_motion(self._pepper, motion)
        if chosen.tilts is not None:
            raise InvalidValueError("motion", "a robot that tilts", "a level one; save_html shows a fall")
        kept = kept_samples(chosen.times, check_positive("fps", fps, "1/s"))
        animation = Animation(default_framerate=1000.0)  # frames are milliseconds
        poses: Array = frame_poses(self._pepper, chosen.positions[kept], self._links)
        for time, state in zip(chosen.times[kept] - chosen.times[0], poses, strict=True):
            for link, pose in zip(self._links, state, strict=True):
                with animation.at_frame(self._part(link), round(1000.0 * float(time))) as frame:
                    frame.set_transform(pose)
        self._visualizer.set_animation(animation, repetitions=repetitions)
        self.display(chosen.positions[-1])

    def _part(self, link: str) -> Any:
        part = self._visualizer
        for name in link_path(link):
            part = part[name]
        return part
