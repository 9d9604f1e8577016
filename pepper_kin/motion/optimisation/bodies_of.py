"""The bodies of a robot and its scene as `near_rows` takes them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Scene
from pepper_kin.collision.checker import coal_geometry
from pepper_kin.model import Box, Capsule, Cylinder, Geometry, PepperModel, Sphere
from pepper_kin.motion.optimisation.near_rows import Bodies
from pepper_kin.motion.optimisation.nearest import BOX, COLUMNS, CYLINDER, HALF, KIND

Array = NDArray[np.float64]


@lru_cache(maxsize=16)
def bodies_of(pepper: PepperModel, scene: Scene, margin: float) -> tuple[Bodies, tuple[str, ...]]:
    """Return the bodies of a robot in a scene, and the frames whose poses they need.

    Pairs are those that `CollisionChecker` measures, less those that never move against each other.  Meshes
    count as their bounding boxes.

    Args:
        pepper: The robot.
        scene: The world around it.
        margin: Distance that each pair keeps [m].
    """
    frames, frame_joint = _frames_of_joints(pepper)
    rows: list[tuple[int, Array, float]] = []
    owners, parents = [], []
    for shape in pepper.collision_shapes:
        parent = pepper.pinocchio_model.frames[pepper.frame_id(shape.link)].parentJoint
        pose = shape.transform_shape_to_link
        if parent:
            pose = _placement(pepper, shape.link) @ pose
            pose = np.linalg.inv(_placement(pepper, frames[frame_joint[parent]])) @ pose
        else:
            pose = _placement(pepper, shape.link) @ pose
        rows.append((frame_joint.get(parent, -1), *_core(shape.geometry, pose)))
        owners.append(shape.link)
        parents.append(parent)
    count = len(rows)
    for item in scene.objects.values():
        rows.append((-1, *_core(item.geometry, item.transform_object_to_world)))
        owners.append(item.name)
        parents.append(0)
    pairs, gaps = _pairs(pepper, owners, parents, count, margin)
    cores = np.array([row[1] for row in rows]).reshape(-1, COLUMNS)
    radius = np.array([row[2] for row in rows], float)
    frame = np.array([row[0] for row in rows], np.int64)
    joint_frame, joint_axis, slides = _joints(pepper, frames)
    carried = _carried(pepper, parents)
    reach = _reaches(cores) + radius
    bodies = Bodies(frame, cores, radius, reach, carried, joint_frame, joint_axis, slides, pairs, gaps)
    return bodies, frames


def _frames_of_joints(pepper: PepperModel) -> tuple[tuple[str, ...], dict[int, int]]:
    """Return one link for each moving joint of the model, and Pinocchio's joint -> place of its link."""
    model = pepper.pinocchio_model
    first: dict[int, str] = {}
    for name in pepper.frame_names:
        first.setdefault(model.frames[pepper.frame_id(name)].parentJoint, name)
    joints = [j for j in range(1, model.njoints) if j in first]
    return tuple(first[j] for j in joints), {j: k for k, j in enumerate(joints)}


def _placement(pepper: PepperModel, link: str) -> Array:
    return np.array(pepper.pinocchio_model.frames[pepper.frame_id(link)].placement.homogeneous)


def _joints(pepper: PepperModel, frames: tuple[str, ...]) -> tuple[Any, Array, Any]:
    """Return frame, axis with origin, and kind of every joint, in the order of the model's coordinates."""
    import pinocchio

    model = pepper.pinocchio_model
    order = sorted(range(len(frames)), key=lambda k: model.joints[_parent(pepper, frames[k])].idx_v)
    axes, origins, slides = [], [], []
    for k in order:
        joint = model.joints[_parent(pepper, frames[k])]
        data = joint.createData()
        joint.calc(data, pinocchio.neutral(model)[joint.idx_q : joint.idx_q + joint.nq])
        column = np.array(data.S).ravel()
        slides.append(bool(np.linalg.norm(column[:3]) > 0.5))
        inverse = np.linalg.inv(_placement(pepper, frames[k]))
        axes.append(inverse[:3, :3] @ (column[:3] if slides[-1] else column[3:]))
        origins.append(inverse[:3, 3])
    return (
        np.array(order, np.int64),
        np.hstack([np.reshape(axes, (-1, 3)), np.reshape(origins, (-1, 3))]),
        np.array(slides, np.bool_),
    )


def _parent(pepper: PepperModel, link: str) -> int:
    return int(pepper.pinocchio_model.frames[pepper.frame_id(link)].parentJoint)


def _carried(pepper: PepperModel, parents: list[int]) -> NDArray[np.bool_]:
    model = pepper.pinocchio_model
    carried = np.zeros((len(parents), model.nv), np.bool_)
    for body, parent in enumerate(parents):
        while parent > 0:
            carried[body, model.joints[parent].idx_v] = True
            parent = model.parents[parent]
    return carried


def _pairs(
    pepper: PepperModel, owners: list[str], parents: list[int], count: int, margin: float
) -> tuple[NDArray[np.int64], Array]:
    disabled = pepper.semantics.disabled_pairs
    pairs = []
    for i in range(count):
        for j in range(i + 1, len(owners)):
            names = (min(owners[i], owners[j]), max(owners[i], owners[j]))
            if parents[i] == parents[j] or (j < count and names in disabled):
                continue
            pairs.append((i, j))
    return np.array(pairs, np.int64).reshape(-1, 2), np.full(len(pairs), margin)


def _core(geometry: Geometry, pose: Array) -> tuple[Array, float]:
    """Return a core in the frame that the pose leads to, shape (COLUMNS,), and the radius around it."""
    center, half, kind, radius = np.array(pose[:3, 3]), np.zeros(3), BOX, 0.0
    if isinstance(geometry, Box):
        half = np.array(geometry.size) / 2
    elif isinstance(geometry, Sphere):
        radius = geometry.radius
    elif isinstance(geometry, Capsule):
        half, radius = np.array([0.0, 0.0, geometry.length / 2]), geometry.radius
    elif isinstance(geometry, Cylinder):
        half, kind = np.array([geometry.radius, geometry.radius, geometry.length / 2]), CYLINDER
    else:
        mesh = coal_geometry(geometry)
        mesh.computeLocalAABB()
        low, high = np.array(mesh.aabb_local.min_), np.array(mesh.aabb_local.max_)
        half, center = (high - low) / 2, center + pose[:3, :3] @ (low + high) / 2
    return np.concatenate([center, np.ravel(pose[:3, :3]), half, [kind]]), radius


def _reaches(cores: Array) -> Array:
    """Return how far cores reach from their centres [m], shape (B,)."""
    half = np.array(cores[:, HALF : HALF + 3])
    half[cores[:, KIND] == CYLINDER, 1] = 0.0
    return np.asarray(np.linalg.norm(half, axis=1))
