"""Peers of planning: RoboPlan in its process, and OMPL over the compiled check."""

from __future__ import annotations

import ctypes
import tempfile
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio
from harness import Served
from ompl import base, geometric, util

import pepper_kin as pk
from pepper_kin import planners
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


class Roboplan(Served):
    """RoboPlan in a process of its own; `time` is that of the last job, measured there [s]."""

    def __init__(self, python: str, pepper: pk.PepperModel) -> None:
        with tempfile.TemporaryDirectory() as folder:
            urdf, srdf = Path(folder) / "pepper.urdf", Path(folder) / "pepper.srdf"
            urdf.write_text(urdf_of_capsules(pepper), encoding="utf-8")
            srdf.write_text(pepper.export("srdf"), encoding="utf-8")
            server = Path(__file__).with_name("planning_roboplan_server.py")
            super().__init__(python, server, urdf, srdf)
            names = self.read()
        self._to = [pepper.joint_names.index(name) for name in names]
        self._from = [names.index(name) for name in pepper.joint_names]
        self.time = 0.0

    def do(self, what: str, **job: Any) -> Any:
        answer = self.ask({"do": what, **job})
        self.time = answer["time"] if answer else 0.0
        return answer

    def furnish(self, scene: pk.Scene) -> None:
        """Put the boxes of a scene around the robot, and nothing else."""
        boxes = []
        for item in scene.objects.values():
            if not isinstance(item.geometry, Box):
                raise TypeError(f"{item.name} is no box")
            boxes.append((list(item.geometry.size), item.transform_object_to_world.tolist()))
        self.do("furnish", boxes=boxes)

    def group(self, name: str, joints: tuple[str, ...]) -> None:
        """Make a group of joints, if there is none of that name."""
        self.do("group", name=name, joints=list(joints))

    def in_collision(self, q: np.ndarray) -> np.ndarray:
        """Return which configurations, shape (m, n), collide, shape (m,)."""
        return np.array(self.do("validity", states=q[:, self._to].tolist())["collides"])

    def connect(self, start, goal, group, step, seed, timeout) -> np.ndarray | None:
        """Return the waypoints of a path, shape (k, n), checked every `step` [rad]; None for none."""

        start, goal = (q[self._to].tolist() for q in (start, goal))
        found = self.do(
            "connect", start=start, goal=goal, joints=group, step=step, seed=seed, timeout=timeout
        )["path"]
        return None if found is None else np.array(found)[:, self._from]


_CHECK = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 2, ctypes.c_int64, ctypes.c_void_p)


def ompl_space(low: np.ndarray, high: np.ndarray) -> base.RealVectorStateSpace:
    """Return OMPL's space of vectors within bounds."""
    space, bounds = base.RealVectorStateSpace(len(low)), base.RealVectorBounds(len(low))
    for i, (least, most) in enumerate(zip(low, high, strict=True)):
        bounds.setLow(i, least)
        bounds.setHigh(i, most)
    space.setBounds(bounds)
    return space


def ompl_states(space: base.RealVectorStateSpace, *vectors: np.ndarray) -> list[Any]:
    """Return OMPL's states of vectors."""
    states = [space.allocState() for _ in vectors]
    for state, vector in zip(states, vectors, strict=True):
        for i, value in enumerate(vector):
            state[i] = float(value)
    return states


class CompiledOmpl:
    """One search, whose callbacks read the numbers of states and call the compiled check, and nothing else.

    With `by_edge` a motion validator is asked for edges; else states are asked for, as OMPL does.
    `inside` is the time within callbacks [s].
    """

    def __init__(self, problem: planners.Problem, *, by_edge: bool) -> None:
        code = problem.validity
        assert isinstance(code, planners.CompiledMotionValidator)
        n, self.inside = problem.n, 0.0
        self._check, self._code, self._memory = _CHECK(code.address), code, code.fresh_memory()
        weights = problem.metric.weights
        self._scale = (1.0 / weights).tolist()
        self._ends = (ctypes.c_double * n)(), (ctypes.c_double * n)()
        self._at = *map(ctypes.addressof, self._ends), self._memory.ctypes.data
        self._step = problem.spacing
        self.space = space = ompl_space(problem.lower * weights, problem.upper * weights)
        self._setup = setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(self._valid)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(problem.spacing / space.getMaximumExtent())
        if by_edge:
            self._edges = _edges_of(self, information)
            information.setMotionValidator(self._edges)
        setup.setStartAndGoalStates(*ompl_states(space, problem.start * weights, problem.goals[0] * weights))
        setup.setPlanner(geometric.RRTConnect(information))

    def solve(self, seconds: float) -> bool:
        """Search for so long [s] at most; return whether there is a path."""
        util.setLogLevel(util.LOG_NONE)
        self._setup.solve(seconds)
        return bool(self._setup.haveExactSolutionPath())

    def _valid(self, state: Any) -> bool:
        begin = time.perf_counter()
        (first, _), (at, _, memory) = self._ends, self._at
        first[:] = [state[i] * scale for i, scale in enumerate(self._scale)]
        found = self._check(at, at, 1, memory) == 1
        self.inside += time.perf_counter() - begin
        return found

    def edge_valid(self, a: Any, b: Any) -> bool:
        """Return whether the states of an edge are valid, the first one aside."""
        begin = time.perf_counter()
        (first, last), (at_first, at_last, memory) = self._ends, self._at
        first[:] = [a[i] * scale for i, scale in enumerate(self._scale)]
        last[:] = [b[i] * scale for i, scale in enumerate(self._scale)]
        steps = int(np.ceil(self.space.distance(a, b) / self._step)) or 1
        found = self._check(at_first, at_last, steps, memory) == steps
        self.inside += time.perf_counter() - begin
        return found


def _edges_of(search: CompiledOmpl, information: Any) -> Any:
    """Return OMPL's validator of motions that asks a search for whole edges."""

    class Edges(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:  # noqa: N802
            return search.edge_valid(a, b)

    return Edges(information)
