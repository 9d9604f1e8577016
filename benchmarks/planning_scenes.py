"""Ten kinds of planning problems: scenes, joints that move, and ends that are free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import pepper_kin as pk

PEPPER = pk.load_pepper().with_requirements("limits")
ARM = ("left_arm",)
TORSO_AND_ARM = ("torso", "left_arm")


@dataclass(frozen=True)
class Kind:
    """One kind of problem.

    Attributes:
        scene: Makes the scene of a problem.
        groups: Joint groups that move.
        planar: Whether the base moves.
    """

    scene: Callable[[np.random.Generator], pk.Scene]
    groups: tuple[str, ...] = TORSO_AND_ARM
    planar: bool = False


TABLE = pk.Scene().add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.70))


def _table(_: np.random.Generator) -> pk.Scene:
    return TABLE


def _shelf(_: np.random.Generator) -> pk.Scene:
    scene = pk.Scene().add_box("back", (0.02, 0.8, 1.4), (0.75, 0.2, 0.7))
    for k, z in enumerate((0.5, 0.75, 1.0)):
        scene = scene.add_box(f"board {k}", (0.3, 0.8, 0.02), (0.6, 0.2, z))
    return scene


def _bin(_: np.random.Generator) -> pk.Scene:
    scene = pk.Scene()
    for name, size, place in (
        ("front", (0.02, 0.4, 0.25), (0.30, 0.25, 0.60)), ("rear", (0.02, 0.4, 0.25), (0.60, 0.25, 0.60)),
        ("left", (0.3, 0.02, 0.25), (0.45, 0.45, 0.60)), ("right", (0.3, 0.02, 0.25), (0.45, 0.05, 0.60)),
    ):  # fmt: skip
        scene = scene.add_box(name, size, place)
    return scene


def _doorway(_: np.random.Generator) -> pk.Scene:
    return (
        pk.Scene().add_box("left post", (0.1, 0.6, 2.0), (0.35, 0.75, 1.0))
        .add_box("right post", (0.1, 0.6, 2.0), (0.35, -0.65, 1.0))
        .add_box("lintel", (0.1, 2.0, 0.3), (0.35, 0.05, 1.55))
    )  # fmt: skip


def _hole(_: np.random.Generator) -> pk.Scene:
    scene = pk.Scene()
    for name, size, place in (
        ("below", (0.03, 1.0, 0.70), (0.38, 0.2, 0.35)), ("above", (0.03, 1.0, 0.5), (0.38, 0.2, 1.35)),
        ("left", (0.03, 0.3, 0.4), (0.38, 0.60, 0.90)), ("right", (0.03, 0.3, 0.4), (0.38, -0.15, 0.90)),
    ):  # fmt: skip
        scene = scene.add_box(name, size, place)
    return scene


def _desk(generator: np.random.Generator) -> pk.Scene:
    scene = _table(generator)
    for k in range(8):
        x, y = generator.uniform(0.35, 0.75), generator.uniform(-0.4, 0.4)
        height = generator.uniform(0.05, 0.2)
        scene = scene.add_cylinder(f"thing {k}", 0.03, height, (x, y, 0.72 + height / 2))
    return scene


def _tray(generator: np.random.Generator) -> pk.Scene:
    held = np.eye(4)
    held[:3, 3] = (0.05, 0.0, 0.03)
    return _table(generator).add_box("tray", (0.20, 0.16, 0.02), (0, 0, 0)).attach("tray", "l_gripper", held)


def _pillar(_: np.random.Generator) -> pk.Scene:
    return pk.Scene().add_cylinder("pillar", 0.15, 2.0, (0.9, 0.0, 1.0))


def _cloud(generator: np.random.Generator) -> pk.Scene:
    points = generator.uniform((0.35, -0.4, 0.60), (0.75, 0.4, 0.72), (20_000, 3))
    return pk.Scene().add_point_cloud("cloud", points, 0.01, voxel=0.03)


KINDS: dict[str, Kind] = {
    "table": Kind(_table),
    "shelf": Kind(_shelf),
    "bin": Kind(_bin),
    "doorway": Kind(_doorway),
    "wall with a hole": Kind(_hole),
    "cluttered desk": Kind(_desk),
    "both arms crossing": Kind(lambda _: pk.Scene(), ("left_arm", "right_arm")),
    "carrying a tray": Kind(_tray),
    "base and arm, pillar": Kind(_pillar, ("left_arm",), planar=True),
    "point cloud": Kind(_cloud),
}


@dataclass(frozen=True, eq=False)
class Problem:
    """Start and goal of a robot in a scene; both are free and can be held."""

    pepper: pk.PepperModel
    scene: pk.Scene
    start: np.ndarray
    goal: np.ndarray
    joints: tuple[str, ...]


def problems(kind: Kind, count: int, seed: int, *, blocked: bool = False) -> list[Problem]:
    """Return problems with ends drawn evenly from the free configurations.

    Args:
        kind: Scene and joints.
        count: How many.
        seed: Of everything.
        blocked: Whether only those count in which the straight way touches something.
    """
    generator = np.random.default_rng(seed)
    pepper = pk.load_pepper(base="planar").with_requirements("limits") if kind.planar else PEPPER
    joints = tuple(name for group in kind.groups for name in pepper.joint_group(group))
    if kind.planar:
        joints = ("BaseX", "BaseY", "BaseYaw", *joints)
    index = [pepper.joint_index(name) for name in joints]
    low, high = pepper.lower_limits[index].copy(), pepper.upper_limits[index].copy()
    if kind.planar:
        low[:3], high[:3] = (-0.2, -1.0, -1.0), (1.8, 1.0, 1.0)
    found: list[Problem] = []
    while len(found) < count:
        scene = kind.scene(generator)
        ends = np.tile(pepper.neutral(), (400, 1))
        ends[:, index] = generator.uniform(low, high, (400, len(index)))
        torque = np.abs(pk.dynamics.gravity_torque(pepper, ends))
        good = ends[(torque <= 0.9 * pepper.effort_limits).all(axis=1)]
        good = good[~pk.collision.checker_for(pepper, scene, 0.005, 0.001).in_collision(good)]
        for start, goal in zip(good[0::2], good[1::2], strict=False):
            way = start + np.linspace(0, 1, 60)[:, None] * (goal - start)
            if blocked and not pk.collision.in_collision(pepper, way, scene).any():
                continue
            found.append(Problem(pepper, scene, start, goal, joints))
            if len(found) == count or len(found) % 3 == 0:
                break
    return found[:count]
