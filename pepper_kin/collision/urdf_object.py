"""Objects of a URDF, such as furniture and things to grasp, as shapes of a scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.mesh_file import points_of, triangles_of
from pepper_kin.collision.scene_object import WOOD, SceneObject
from pepper_kin.collision.solids import ConvexMesh, SceneGeometry, TriangleMesh
from pepper_kin.exceptions import ModelError
from pepper_kin.model.joint_vectors import check_choice
from pepper_kin.model.kinematic_tree import placed_joints
from pepper_kin.model.shapes import NO_COLOR, Mesh, Shape
from pepper_kin.model.urdf_document import UrdfDocument, parse_urdf
from pepper_kin.model.urdf_source import mesh_folders, read_source, warned

MESHES = ("hull", "surface")


def objects_of_urdf(
    name: str, urdf: str | Path, place: NDArray[np.float64], meshes: str, package_dirs: Sequence[str | Path]
) -> Iterator[SceneObject]:
    """Yield the collision shapes of a description, all joints at zero; see `Scene.add_urdf`.

    Args:
        name: Name of the object.
        urdf: Path or text.
        place: Pose of the root link in the world, shape (4, 4).
        meshes: "hull" or "surface".
        package_dirs: Folders that contain packages.
    """
    check_choice("meshes", meshes, MESHES)
    with warned(urdf):
        document = parse_urdf(read_source(urdf), mesh_folders(urdf, package_dirs))
        visuals, collisions = document.shapes
        if not collisions:
            raise ModelError(f"URDF: {document.name!r} has no collision shapes")
    yield from objects_of_shapes(name, visuals, collisions, _link_poses(document, place), meshes)


def objects_of_shapes(
    name: str,
    visuals: Sequence[Shape],
    collisions: Sequence[Shape],
    poses: Mapping[str, NDArray[np.float64]],
    meshes: str,
) -> Iterator[SceneObject]:
    """Yield collision shapes as obstacles, in the colors of their links.

    Args:
        name: Name of the object if there is one shape; others are `name/shape`.
        visuals: Shapes that define the colors.
        collisions: Shapes of the obstacles.
        poses: Poses of the links in the world, each (4, 4).
        meshes: "hull" or "surface".

    Raises:
        InvalidValueError: for other meshes.
    """
    check_choice("meshes", meshes, MESHES)
    colors = {shape.link: shape.color for shape in reversed(visuals) if shape.color != NO_COLOR}
    called = [name] if len(collisions) == 1 else [f"{name}/{shape.name}" for shape in collisions]
    for own, shape in zip(called, collisions, strict=True):
        geometry: SceneGeometry
        if not isinstance(shape.geometry, Mesh):
            geometry = shape.geometry
        elif meshes == "hull":
            geometry = ConvexMesh(points_of(own, shape.geometry.path, shape.geometry.scale))
        else:
            geometry = TriangleMesh(*triangles_of(own, shape.geometry.path, None, shape.geometry.scale))
        pose = poses[shape.link] @ shape.transform_shape_to_link
        yield SceneObject(own, geometry, pose, colors.get(shape.link, WOOD))


def _link_poses(document: UrdfDocument, place: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return the poses of all links in the world, joints at zero, each (4, 4)."""
    placed, poses = placed_joints(document), dict[str, NDArray[np.float64]]()
    for link in document.links:
        chain = [link]
        while (above := placed.get(chain[-1])) is not None and above.joint.parent not in poses:
            chain.append(above.joint.parent)
        for one in reversed(chain):
            above = placed.get(one)
            poses[one] = (
                place if above is None else poses[above.joint.parent] @ above.transform_child_to_parent
            )
    return poses
