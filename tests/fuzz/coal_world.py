"""Robots among obstacles by Pinocchio and coal alone: what the verdicts of the library are compared with.

It reads the URDF's and the SRDF's text and shares no code with the library.  A robot has two sets of shapes
and pairs.  What touches in `must` has to touch: surfaces as the files have them, and pairs that are surely
checked.  What touches in `may` may touch: convex hulls of meshes, and all pairs that could be checked.
Between the two, as where a small thing is inside a closed mesh, nothing is asked.
"""

import csv
import xml.etree.ElementTree as ET
from functools import cache
from importlib import metadata, resources
from pathlib import Path

import coal
import numpy as np
import pinocchio

import pepper_kin as pk

ROBOTS = ("pepper", "pepper on wheels", "panda", "ur5", "talos")
FILES = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "talos_data/srdf/talos.srdf"),
}
TIE = 2e-6
"""Nearer to a margin than this nothing is asked [m]."""
TIE_OF_RANGE = 1e-9  # [rad]
ANGLE_PER_MARGIN = 10.0
"""A margin between parts of the robot is turned into an angle for neighbors, as the docs say [rad/m]."""


class Robot:
    """A robot of the library, and its text as Pinocchio reads it."""

    def __init__(self, name: str) -> None:
        if name.startswith("pepper"):
            base, hands = ("fixed", "locked") if name == "pepper" else ("planar", "mimic")
            self.model = pk.load_pepper(base=base, hands=hands)
            urdf = pk.model.pepper_urdf(base=base, hands=hands)
            srdf, folders = (resources.files("pepper_kin.urdf") / "pepper.srdf").read_text("utf-8"), []
        else:
            share = Path(str(metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share")))
            files = [share / "example-robot-data" / "robots" / file for file in FILES[name]]
            self.model = pk.load_robot(*files, [share])
            urdf, srdf = (file.read_text("utf-8") for file in files)
            folders = [str(share)]
        self.name, self.urdf = name, urdf
        self.inner = pinocchio.buildModelFromXML(urdf)
        self.shapes = pinocchio.buildGeomFromUrdfString(
            self.inner, urdf, pinocchio.GeometryType.COLLISION, package_dirs=folders
        )
        self.hulls = [_hull(item.geometry) for item in self.shapes.geometryObjects]
        self.links = [self.inner.frames[item.parentFrame].name for item in self.shapes.geometryObjects]
        self.disabled = {
            frozenset((pair.get("link1"), pair.get("link2"))): pair.get("reason", "")
            for pair in ET.fromstring(srdf).iter("disable_collisions")
        }
        self.mimics = {
            joint.get("name"): joint.find("mimic")
            for joint in ET.fromstring(urdf).iter("joint")
            if joint.find("mimic") is not None
        }
        self.tables = _tables(self.model.joint_names, self.disabled) if name.startswith("pepper") else []
        self.low = np.where(np.isfinite(self.model.lower_limits), self.model.lower_limits, -np.pi)
        self.high = np.where(np.isfinite(self.model.upper_limits), self.model.upper_limits, np.pi)
        for k, joint in enumerate(self.model.joint_names):
            if joint in ("BaseX", "BaseY"):
                self.low[k], self.high[k] = -0.5, 0.5
        self.data = self.inner.createData()

    def full(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's configuration of joint positions, shape (n,)."""
        values = dict(zip(self.model.joint_names, q.tolist(), strict=True))
        full = pinocchio.neutral(self.inner)
        for joint, name in zip(list(self.inner.joints)[1:], list(self.inner.names)[1:], strict=True):
            factor, offset, leader = 1.0, 0.0, name
            while leader in self.mimics:
                mimic = self.mimics[leader]
                offset = offset + factor * float(mimic.get("offset", 0.0))
                factor, leader = factor * float(mimic.get("multiplier", 1.0)), mimic.get("joint")
            value = factor * values[leader] + offset
            place = joint.idx_q
            full[place : place + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        return full

    def holding_torque(self, q: np.ndarray, payload: dict[str, float] | None = None) -> np.ndarray:
        """Return what gravity asks of each joint, shape (n,) [N m or N], with masses at frames [kg].

        The share of joints that follow another is that one's.
        """
        full = self.full(q)
        torque = np.array(pinocchio.computeGeneralizedGravity(self.inner, self.data, full))
        for frame, mass in (payload or {}).items():
            axes = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
            jacobian = pinocchio.computeFrameJacobian(
                self.inner, self.data, full, self.inner.getFrameId(frame), axes
            )
            torque -= mass * jacobian[:3].T @ self.inner.gravity.linear
        found = np.zeros(len(self.model.joint_names))
        for joint, name in zip(list(self.inner.joints)[1:], list(self.inner.names)[1:], strict=True):
            factor, leader = 1.0, name
            while leader in self.mimics:
                mimic = self.mimics[leader]
                factor, leader = factor * float(mimic.get("multiplier", 1.0)), mimic.get("joint")
            found[self.model.joint_names.index(leader)] += factor * torque[joint.idx_v]
        return found

    def range_gap(self, q: np.ndarray) -> float:
        """Return by how much neighbors keep their dependent ranges, the least [rad]; below zero: touching."""
        gaps = [np.inf]
        for first, second, rows in self.tables:
            x, y = q[first], q[second]
            near = [row for row in rows if row[0] <= x][-1:] + [row for row in rows if row[0] >= x][:1]
            gaps += [min(y - low, high - y) for _, low, high in near or rows[:1]]
        return float(min(gaps))


@cache
def robot_of(name: str) -> Robot:
    """Return a robot, read once."""
    return Robot(name)


class World:
    """A robot among the objects of a scene, by coal.

    Args:
        robot: The robot.
        scene: The scene; its numbers are read, its code is not.
        margin: Kept to objects of the world [m].
        self_margin: Kept between parts of the robot, what it holds included [m].
    """

    def __init__(self, robot: Robot, scene: pk.Scene, margin: float = 0.0, self_margin: float = 0.0) -> None:
        self.robot, self.self_margin = robot, self_margin
        self.must = self._model(scene, margin - TIE, self_margin - TIE, hulls=False)
        self.may = self._model(scene, margin + TIE, self_margin + TIE, hulls=True)

    def _model(self, scene: pk.Scene, margin: float, self_margin: float, hulls: bool) -> tuple:
        robot = self.robot
        geometry, kinds = pinocchio.GeometryModel(), []
        for k, item in enumerate(robot.shapes.geometryObjects):
            shape = robot.hulls[k] if hulls else item.geometry
            geometry.addGeometryObject(_object(f"r{k}", item.parentJoint, item.placement, shape))
            kinds.append(("robot", robot.links[k], 0.0))
        for name, item in scene.attached.items():
            frame = robot.inner.frames[robot.inner.getFrameId(item.frame)]
            for placed, shape, extra in _parts(item.geometry, hulls):
                pose = frame.placement * pinocchio.SE3(np.array(item.transform_object_to_frame)) * placed
                geometry.addGeometryObject(_object(f"a{len(kinds)}", frame.parentJoint, pose, shape))
                kinds.append(("attached", name, extra))
        for name, item in scene.objects.items():
            for placed, shape, extra in _parts(item.geometry, hulls):
                pose = pinocchio.SE3(np.array(item.transform_object_to_world)) * placed
                geometry.addGeometryObject(_object(f"w{len(kinds)}", 0, pose, shape))
                kinds.append(("world", name, extra))
        margins = []
        for i, (one, _, pad) in enumerate(kinds):
            for j in range(i + 1, len(kinds)):
                two, _, other = kinds[j]
                if one == "world" or not self._checked(scene, kinds[i], kinds[j], hulls):
                    continue
                joints = [geometry.geometryObjects[k].parentJoint for k in (i, j)]
                if two != "world" and joints[0] == joints[1]:
                    continue
                geometry.addCollisionPair(pinocchio.CollisionPair(i, j))
                value = (margin if two == "world" else self_margin) + pad + other
                shapes = [geometry.geometryObjects[k].geometry for k in (i, j)]
                if any(isinstance(shape, coal.BVHModelBase) for shape in shapes):
                    value = max(value, 0.0)  # coal refuses less than that for surfaces
                margins.append(value)
        data = pinocchio.GeometryData(geometry)
        for request, value in zip(data.collisionRequests, margins, strict=True):
            request.security_margin = value
        return geometry, data

    def _checked(self, scene: pk.Scene, one: tuple, two: tuple, all_pairs: bool) -> bool:
        (kind, first, _), (other, second, _) = one, two
        if (min(first, second), max(first, second)) in scene.allowed:
            return False
        if kind == other == "robot":
            return frozenset((first, second)) not in self.robot.disabled
        if other == "attached" and kind == "robot":
            return all_pairs and first not in scene.attached[second].touch_links
        return not (kind == other == "attached" and first == second)

    def _touches(self, side: tuple, q: np.ndarray) -> bool:
        robot = self.robot
        return bool(
            pinocchio.computeCollisions(robot.inner, robot.data, side[0], side[1], robot.full(q), True)
        )

    def must_touch(self, q: np.ndarray) -> bool:
        """Return whether the robot surely touches something at q, shape (n,)."""
        gap = self.robot.range_gap(q) - ANGLE_PER_MARGIN * self.self_margin
        return gap < -TIE_OF_RANGE or self._touches(self.must, q)

    def verdict(self, q: np.ndarray) -> bool | None:
        """Return whether the robot touches something at q, shape (n,); None where nothing is asked."""
        if self.must_touch(q):
            return True
        gap = self.robot.range_gap(q) - ANGLE_PER_MARGIN * self.self_margin
        return None if gap < TIE_OF_RANGE or self._touches(self.may, q) else False


def random_scene(rng: np.random.Generator, robot: Robot, count: int, *, holding: bool = False) -> pk.Scene:
    """Return a scene of boxes, balls, cylinders, capsules, convex meshes, clouds and floors about a robot."""
    scene, pepper = pk.Scene(), robot.name.startswith("pepper")
    inner, outer = (0.35, 0.9) if pepper or robot.name == "talos" else (0.25, 0.8)
    height = 1.3 if pepper else 1.0
    while len(scene.objects) < count:
        angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(inner, outer)
        place = [radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.1, height)]
        rpy, name = rng.uniform(-3, 3, 3), f"thing{len(scene.objects)}"
        match rng.integers(7):
            case 0:
                scene = scene.add_box(name, rng.uniform(0.02, 0.4, 3), place, rpy)
            case 1:
                scene = scene.add_sphere(name, rng.uniform(0.01, 0.2), place)
            case 2:
                scene = scene.add_cylinder(name, *rng.uniform(0.02, 0.3, 2), place, rpy)
            case 3:
                scene = scene.add_capsule(name, *rng.uniform(0.02, 0.2, 2), place, rpy)
            case 4:
                points = rng.normal(size=(rng.integers(5, 20), 3)) * rng.uniform(0.03, 0.15)
                scene = scene.add_convex_mesh(name, points, place, rpy)
            case 5:
                points = rng.uniform(-0.15, 0.15, (int(rng.integers(1, 40)), 3))
                scene = scene.add_point_cloud(name, points, rng.uniform(0.002, 0.02), place, rpy, voxel=None)
            case _:
                tilt = [*rng.uniform(-0.2, 0.2, 2), 1.0]
                scene = scene.add_half_space(name, tilt, -rng.uniform(0.3, 1.0))
    if holding:
        frame = {"panda": "panda_hand", "ur5": "tool0", "talos": "gripper_left_base_link"}.get(
            robot.name, "l_gripper"
        )
        pose = np.eye(4)
        pose[:3, 3] = rng.uniform(-0.05, 0.1, 3)
        size = rng.uniform(0.02, 0.12, 3)
        scene = scene.add_box("held", size, (5.0, 0.0, 0.0)).attach("held", frame, pose)
    return scene


def random_states(rng: np.random.Generator, robot: Robot, count: int) -> np.ndarray:
    """Return configurations within the limits, shape (count, n)."""
    return rng.uniform(robot.low, robot.high, (count, robot.low.size))


def _object(name: str, joint: int, placement: pinocchio.SE3, shape: object) -> pinocchio.GeometryObject:
    if not isinstance(shape, coal.Halfspace):
        shape.computeLocalAABB()
    return pinocchio.GeometryObject(name, joint, 0, placement, shape)


def _hull(shape: object) -> object:
    if isinstance(shape, coal.BVHModelBase):
        shape.buildConvexHull(True, "Qt")
        return shape.convex
    return shape


def _parts(geometry: object, hulls: bool) -> list[tuple[pinocchio.SE3, object, float]]:
    """Return coal's shapes of an object of a scene: poses in it, shapes, and how far they are padded [m]."""
    here = pinocchio.SE3.Identity()
    match geometry:
        case pk.model.Box():
            return [(here, coal.Box(*geometry.size), 0.0)]
        case pk.model.Sphere():
            return [(here, coal.Sphere(geometry.radius), 0.0)]
        case pk.model.Cylinder():
            return [(here, coal.Cylinder(geometry.radius, geometry.length), 0.0)]
        case pk.model.Capsule():
            return [(here, coal.Capsule(geometry.radius, geometry.length), 0.0)]
        case pk.collision.HalfSpace():
            return [(here, coal.Halfspace(np.array([0.0, 0.0, 1.0]), geometry.offset), 0.0)]
        case pk.collision.PointCloud():
            balls = [pinocchio.SE3(np.eye(3), point) for point in np.array(geometry.points)]
            return [(ball, coal.Sphere(max(geometry.radius, 1e-9)), 0.0) for ball in balls]
        case pk.collision.ConvexMesh():
            tree = coal.BVHModelOBBRSS()
            tree.beginModel(len(geometry.faces), len(geometry.vertices))
            tree.addVertices(np.array(geometry.vertices))
            tree.addTriangles(np.array(geometry.faces))
            tree.endModel()
            tree.buildConvexHull(True, "Qt")
            return [(here, tree.convex, geometry.padding)]
    raise TypeError(geometry)


def _tables(
    joints: tuple[str, ...], disabled: dict[frozenset[str], str]
) -> list[tuple[int, int, list[tuple[float, float, float]]]]:
    """Return the tables of dependent ranges: places of two joints, and rows of position, least and most."""
    tables: dict[tuple[int, int], list[tuple[float, float, float]]] = {}
    text = (resources.files("pepper_kin.urdf") / "data" / "anti_collision.csv").read_text("utf-8")
    for row in csv.DictReader(text.splitlines()):
        pair = frozenset(row["link_pair"].split("-"))
        if disabled.get(pair) == "DependentRange":
            key = joints.index(row["joint_1"]), joints.index(row["joint_2"])
            columns = ("value_1_rad", "joint_2_free_min_rad", "joint_2_free_max_rad")
            tables.setdefault(key, []).append(tuple(float(row[name]) for name in columns))
    return [(*places, sorted(rows)) for places, rows in tables.items()]
