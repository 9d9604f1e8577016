"""The scene of the pages: objects around the robot, and attached objects."""

from __future__ import annotations

from pepper_kin.collision import Scene
from pepper_kin.model import PepperModel
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.server.board import Board, Root


class DrawnScene:
    """A drawn scene: when it is replaced, only changed objects are drawn again.

    Args:
        pepper: Model of the robot.
        board: Board to draw on.
        objects_root: Path of the group for objects of the world.
        held_root: Path of the group for attached objects.
    """

    def __init__(self, pepper: PepperModel, board: Board, objects_root: Root, held_root: Root) -> None:
        self._pepper, self._board = pepper, board
        self._objects_root, self._held_root = objects_root, held_root
        self.scene = Scene()

    def replace(self, scene: Scene) -> None:
        """Replace the scene.

        Raises:
            UnknownNameError: for an object on a frame that the robot does not have.
        """
        for held in scene.attached.values():
            self._pepper.frame_id(held.frame)
        before, self.scene = self.scene, scene
        for name in before.objects.keys() - scene.objects.keys():
            self._board.erase(self._path(name))
        for name in before.attached.keys() - scene.attached.keys():
            self._board.erase((*self._held_root, as_path(name)))
        for name, thing in scene.objects.items():
            if before.objects.get(name) is not thing:
                pose = thing.transform_object_to_world
                self._board.draw(self._path(name), (Drawable(name, None, thing.geometry, pose, thing.color),))
        for name, held in scene.attached.items():
            if before.attached.get(name) is not held:
                pose = held.transform_object_to_frame
                drawable = Drawable(name, held.frame, held.geometry, pose, held.color)
                self._board.draw((*self._held_root, as_path(name)), (drawable,))

    def _path(self, name: str) -> Root:
        return (*self._objects_root, as_path(name))


def as_path(name: str) -> str:
    """Return an object's name as one level of a scene path."""
    return name.replace("/", "_")
