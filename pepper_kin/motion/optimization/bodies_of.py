"""The bodies of a robot and its scene as `near_rows` takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.bodies import bodies, checked_pairs
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.motion.optimization.near_rows import Bodies
from pepper_kin.motion.optimization.nearest import BOX, COLUMNS, CYLINDER, HALF, KIND

VAST = 25.0
"""Half length of the box that stands for a half-space [m]."""


@kept_for_robot(most=16)
def bodies_of(pepper: PepperModel, scene: Scene, margin: float) -> tuple[Bodies, tuple[str, ...]]:
    """Return the bodies of a robot in a scene, and the frames whose poses they need.

    Pairs are those that `CollisionChecker` measures, less those that never move against each other.  Meshes
    and clouds count as their bounding boxes, half-spaces as vast ones.

    Args:
        pepper: The robot.
        scene: The world around it.
        margin: Distance that each pair keeps [m].
    """
    frames, frame_joint, from_joint = _frames_of_joints(pepper)
    all_bodies = bodies(pepper, scene)
    rows: list[tuple[int, Array, float]] = []
    for body in all_bodies:
        pose = np.array(body.geometry_object.placement.homogeneous)
        if body.joint:
            pose = from_joint[frame_joint[body.joint]] @ pose
        core, radius = _core(body.geometry_object.geometry, pose)
        rows.append((frame_joint.get(body.joint, -1), core, radius + body.padding))
    parents = [body.joint for body in all_bodies]
    listed = np.array(checked_pairs(pepper, scene, all_bodies), np.int64).reshape(-1, 2)
    of = np.array(parents, np.int64)
    pairs = np.ascontiguousarray(listed[of[listed[:, 0]] != of[listed[:, 1]]])
    gaps = np.full(len(pairs), margin)
    cores = np.array([row[1] for row in rows]).reshape(-1, COLUMNS)
    radii = np.array([row[2] for row in rows], float)
    frame = np.array([row[0] for row in rows], np.int64)
    joint_frame, joint_axis, slides = _joints(pepper, frames)
    carried = _carried(pepper, parents)
    reach = _reaches(cores) + radii
    made = Bodies(frame, cores, radii, reach, carried, joint_frame, joint_axis, slides, pairs, gaps)
    return made, frames


@kept_for_robot(most=16)
def _frames_of_joints(pepper: PepperModel) -> tuple[tuple[str, ...], dict[int, int], tuple[Array, ...]]:
    """Return a link for each moving joint, Pinocchio's joint -> its place, and the joints' poses there."""
    model = pepper.inner_model
    first: dict[int, str] = {}
    for name in pepper.frame_names:
        first.setdefault(model.frames[pepper.frame_id(name)].parentJoint, name)
    joints = [j for j in range(1, model.njoints) if j in first]
    frames = tuple(first[j] for j in joints)
    poses = tuple(np.asarray(np.linalg.inv(_placement(pepper, frame)), float) for frame in frames)
    return frames, {j: k for k, j in enumerate(joints)}, poses


def _placement(pepper: PepperModel, link: str) -> Array:
    return np.array(pepper.inner_model.frames[pepper.frame_id(link)].placement.homogeneous)


@kept_for_robot(most=16)
def _joints(pepper: PepperModel, frames: tuple[str, ...]) -> tuple[Any, Array, Any]:
    """Return frame, axis with origin, and kind of every joint, in the order of the model's coordinates."""
    import pinocchio

    model = pepper.inner_model
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
        np.array(slides, np.int64),
    )


def _parent(pepper: PepperModel, link: str) -> int:
    return int(pepper.inner_model.frames[pepper.frame_id(link)].parentJoint)


def _carried(pepper: PepperModel, parents: list[int]) -> NDArray[np.int64]:
    model, rows = pepper.inner_model, {}
    for parent in set(parents):
        row, joint = np.zeros(model.nv, np.int64), parent
        while joint > 0:
            row[model.joints[joint].idx_v] = 1
            joint = model.parents[joint]
        rows[parent] = row
    return np.array([rows[parent] for parent in parents], np.int64).reshape(-1, model.nv)


def _core(shape: Any, pose: Array) -> tuple[Array, float]:
    """Return a core in the frame that the pose leads to, shape (COLUMNS,), and the radius around it."""
    import coal

    center, half, kind, radius = np.array(pose[:3, 3]), np.zeros(3), BOX, 0.0
    if isinstance(shape, coal.Box):
        half = np.array(shape.halfSide)
    elif isinstance(shape, coal.Sphere):
        radius = float(shape.radius)
    elif isinstance(shape, coal.Capsule):
        half, radius = np.array([0.0, 0.0, shape.halfLength]), float(shape.radius)
    elif isinstance(shape, coal.Cylinder):
        half, kind = np.array([shape.radius, shape.radius, shape.halfLength]), CYLINDER
    elif isinstance(shape, coal.Halfspace):
        half = np.full(3, VAST)
        center += pose[:3, :3] @ np.array([0.0, 0.0, shape.d - VAST])
    else:
        shape.computeLocalAABB()
        low, high = np.array(shape.aabb_local.min_), np.array(shape.aabb_local.max_)
        half, center = (high - low) / 2, center + pose[:3, :3] @ (low + high) / 2
    return np.concatenate([center, np.ravel(pose[:3, :3].T), half, [kind]]), radius


def _reaches(cores: Array) -> Array:
    """Return how far cores reach from their centers [m], shape (B,)."""
    half = np.array(cores[:, HALF : HALF + 3])
    half[cores[:, KIND] == CYLINDER, 1] = 0.0
    return np.asarray(np.linalg.norm(half, axis=1))
