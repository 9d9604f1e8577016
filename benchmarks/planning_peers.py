"""RoboPlan beside our planning: the robot and the scene as it takes them, and its process."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.model import Box, Capsule, Cylinder, Sphere


def urdf_of_capsules(pepper: pk.PepperModel) -> str:
    """Return the robot with capsules as Pinocchio reads them: cylinders that the link declares to be some.

    `export` writes a capsule as a cylinder and two balls, which any reader knows, but which takes three
    times as many shapes.
    """
    root = ElementTree.fromstring(pepper.export("urdf", mesh_paths="absolute"))
    links = {str(link.get("name")): link for link in root.iter("link")}
    for link in links.values():
        for shape in link.findall("collision"):
            link.remove(shape)
    for k, shape in enumerate(pepper.collision_shapes):
        link, pose = links[shape.link], shape.transform_shape_to_link
        element = ElementTree.SubElement(link, "collision", name=f"shape_{k}")
        turn = pinocchio.rpy.matrixToRpy(pose[:3, :3])
        ElementTree.SubElement(element, "origin", xyz=_words(pose[:3, 3]), rpy=_words(turn))
        _add_geometry(ElementTree.SubElement(element, "geometry"), shape.geometry)
        if isinstance(shape.geometry, Capsule):
            checking = link.find("collision_checking")
            if checking is None:
                checking = ElementTree.SubElement(link, "collision_checking")
            ElementTree.SubElement(checking, "capsule", name=f"shape_{k}")
    return ElementTree.tostring(root, encoding="unicode")


def _add_geometry(parent: ElementTree.Element, geometry: Any) -> None:
    if isinstance(geometry, Box):
        ElementTree.SubElement(parent, "box", size=_words(geometry.size))
    elif isinstance(geometry, Sphere):
        ElementTree.SubElement(parent, "sphere", radius=str(geometry.radius))
    elif isinstance(geometry, Capsule | Cylinder):
        sizes = {"radius": str(geometry.radius), "length": str(geometry.length)}
        ElementTree.SubElement(parent, "cylinder", sizes)
    else:
        raise TypeError(f"no primitive: {geometry}")


def _words(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)


class Roboplan:
    """RoboPlan in a process of its own.

    Args:
        python: Interpreter of the environment that RoboPlan is installed in.
        pepper: The robot.

    Attributes:
        time: Of the last job, measured in the other process [s].
    """

    def __init__(self, python: str, pepper: pk.PepperModel) -> None:
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        urdf, srdf = folder / "pepper.urdf", folder / "pepper.srdf"
        urdf.write_text(urdf_of_capsules(pepper), encoding="utf-8")
        srdf.write_text(pepper.export("srdf"), encoding="utf-8")
        self._complaints = (folder / "stderr").open("w+")
        server = Path(__file__).with_name("planning_roboplan_server.py")
        self._process = subprocess.Popen(
            [python, str(server), str(urdf), str(srdf)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._complaints, text=True,
        )  # fmt: skip
        names = json.loads(self._read())
        self._to = [pepper.joint_names.index(name) for name in names]
        self._from = [names.index(name) for name in pepper.joint_names]
        self.time = 0.0

    def furnish(self, scene: pk.Scene) -> None:
        """Put the boxes of a scene around the robot, and nothing else."""
        boxes = []
        for item in scene.objects.values():
            if not isinstance(item.geometry, Box):
                raise TypeError(f"{item.name} is no box")
            boxes.append((list(item.geometry.size), item.transform_object_to_world.tolist()))
        self._ask("furnish", boxes=boxes)

    def group(self, name: str, joints: tuple[str, ...]) -> None:
        """Make a group of joints, if there is none of that name."""
        self._ask("group", name=name, joints=list(joints))

    def in_collision(self, q: np.ndarray) -> np.ndarray:
        """Return which configurations, shape (m, n), collide, shape (m,)."""
        answer = self._ask("validity", states=q[:, self._to].tolist())
        self.time = answer["time"]
        return np.array(answer["collides"])

    def connect(
        self, start: np.ndarray, goal: np.ndarray, group: str, step: float, seed: int, timeout: float
    ) -> np.ndarray | None:
        """Return the way-points of a path, shape (k, n), checked every `step` [rad]; None for none."""
        ends = (q[self._to].tolist() for q in (start, goal))
        answer = self._ask(
            "connect", **dict(zip(("start", "goal"), ends, strict=True)), joints=group, step=step, seed=seed,
            timeout=timeout,
        )  # fmt: skip
        self.time = answer["time"]
        return None if answer["path"] is None else np.array(answer["path"])[:, self._from]

    def close(self) -> None:
        """End the process."""
        self._process.communicate()
        self._complaints.close()
        self._folder.cleanup()

    def _ask(self, what: str, **job: Any) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": what, **job}) + "\n")
        self._process.stdin.flush()
        return json.loads(self._read())

    def _read(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._complaints.seek(0)
            raise RuntimeError(f"RoboPlan's process ended: {self._complaints.read()[-300:]}")
        return line


def roboplan(python: str | None, pepper: pk.PepperModel) -> Roboplan | None:
    """Return RoboPlan, or None, with a message, where no environment was named or it does not run there."""
    if python is None:
        print("RoboPlan is left out: name the interpreter that has it with --roboplan-python")
        return None
    try:
        return Roboplan(python, pepper)
    except (RuntimeError, OSError) as error:
        print(f"RoboPlan is left out: {error}")
        return None
