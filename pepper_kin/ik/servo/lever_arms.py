"""How far one radian of a joint can move any point of the body."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pepper_kin.ik.tasks.task import Array
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import read_only


@lru_cache(maxsize=32)
def lever_arms(pepper: PepperModel) -> Array:
    """Return R, shape (n,) [m/rad or 1]: no point of the body moves by more than sum_i R_i |dq_i|.

    R_i is the sum of the offsets along the longest chain of joints that joint i carries, with the bounding
    sphere of the shape at its end; 1 for a joint that slides.
    """
    import pinocchio

    from pepper_kin.collision.coal_shapes import coal_geometry

    model = pepper.pinocchio_model
    longest = np.zeros(model.njoints)
    for shape in pepper.collision_shapes:
        geometry = coal_geometry(shape.geometry)
        geometry.computeLocalAABB()
        frame = model.frames[pepper.frame_id(shape.link)]
        center = frame.placement.act(
            pinocchio.SE3(shape.transform_shape_to_link).act(np.array(geometry.aabb_center))
        )
        reach = float(np.linalg.norm(center)) + geometry.aabb_radius
        longest[frame.parentJoint] = max(longest[frame.parentJoint], reach)
    full = np.ones(model.nv)
    for joint in range(model.njoints - 1, 0, -1):
        first, travel = model.joints[joint].idx_v, 0.0
        if _slides(model.joints[joint]):
            ends = model.lowerPositionLimit[first], model.upperPositionLimit[first]
            travel = max(abs(ends[0]), abs(ends[1]))
        else:
            full[first] = longest[joint]
        above = model.parents[joint]
        offset = float(np.linalg.norm(model.jointPlacements[joint].translation)) + travel
        longest[above] = max(longest[above], offset + longest[joint])
    return read_only(np.abs(pepper.full_map).T @ full)


def _slides(joint: object) -> bool:
    name: str = joint.shortname()  # type: ignore[attr-defined]
    return name.removeprefix("JointModel").startswith("P")
