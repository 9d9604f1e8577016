"""Records of the tables in blocks (`layout`) and of their workspace, field by field."""

from __future__ import annotations

from typing import Any

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import lanes
from pepper_kin.kernels.records import RecordView, double, single, word

HEAD = RecordView(
    "HEAD",
    **dict.fromkeys(("joints", "classes", "groups", "bodies", "links"), word),
    **dict.fromkeys(("margin", "self_margin", "range_margin"), double),
    **dict.fromkeys(("blocked", "scene", "scene_size"), word),
    **dict.fromkeys(("gravity_kernel", "gravity_lanes", "placing_kernel"), word),
)
"""What a block begins with: numbers of joints, classes of pairs, groups, bodies and links; margins, of which
`range_margin` is to joint ranges what `self_margin` is to pairs [rad]; whether nothing is free; address and
size of the scene's block; address of the kernel of what holds still, 0 where that is not checked, and how
many states it takes side by side; address of `placing_kernel`, whose work is the section PLACING, or 0 where
bodies are placed one by one."""
_NAMES = "parent slides coordinate moves first_group group_end coarse first_part part_end"
BODY = RecordView("BODY", **dict.fromkeys(_NAMES.split(), word))
"""A body: index of its parent pose, whether its joint is prismatic, its coordinate, whether it moves, the
range of its groups, its coarse sphere, the range of its parts."""
FRAME = RecordView("FRAME", rotation=9 * single, origin=3 * single, gain=single, offset=single)
"""A body's frame: rotation row by row, origin, then gain and offset of the body's coordinate."""
GROUP = RecordView(
    "GROUP",
    body=word,
    coarse=word,
    first_ball=word,
    ball_end=word,
    checked=word,
    first_part=word,
    part_end=word,
)
"""A group: its body, coarse sphere, range of spheres, whether it is checked, range of parts."""
PART = RecordView("PART", coarse=word, first_ball=word, ball_end=word, first_core=word, core_end=word)
"""A part: its coarse sphere, range of spheres, range of cores; a group of several parts starts with a part
without cores, which covers the whole group."""
BALL = RecordView("BALL", center=3 * single, outer=single, inner=single)
"""A sphere: its center in its body's frame, and its outer and inner radius."""
_AXES = dict.fromkeys(("center", "x_axis", "y_axis", "z_axis"), 3 * single)
_CORE = {"kind": single, "outer": single, "inner": single, "half": 3 * single, **_AXES}
CORE = RecordView("CORE", **_CORE)
"""A core: its kind, outer and inner radius, half lengths, center and axes in its body's frame."""
OBJECT = RecordView("OBJECT", **_CORE, bounding=single)
"""An object of a scene: the fields of a core in the world frame, and its bounding radius."""
NODE = RecordView(
    "NODE", low=3 * single, high=3 * single, after=single, first_object=single, object_end=single
)
"""A node of a tree of boxes, followed by its branches: minimum and maximum corner, the node after all its
branches, the range of its objects."""
ROOT = RecordView("ROOT", first_node=word, node_end=word, first_object=word, object_end=word)
"""A tree of boxes: the range of its nodes, the range of its objects."""
BOXES = RecordView("BOXES", low=3 * lanes, high=3 * lanes)
"""The boxes around eight objects: minimum and maximum corners."""
_BALLS = dict.fromkeys(("covered", "covered_coarse", "exact", "exact_coarse"), word)
_REST = dict.fromkeys(("pair_class", "first_part", "part_end"), word)
LINK = RecordView("LINK", **_BALLS, touching=single.padded(8), **_REST)
"""A pair of bodies: the body with spheres and its coarse sphere, the body with cores and its coarse sphere,
the distance at which the coarse spheres touch, the pair's class, its range in LINK_PARTS."""
LINK_PART = RecordView(
    "LINK_PART", covered=word, exact=word, touching=single.padded(8), first_side=word, side_end=word
)
"""A pair of parts of the two bodies: the parts, the distance at which their coarse spheres touch, its range
in SIDES."""
SIDE = RecordView("SIDE", core=word, first_range=word, range_end=word)
"""A core of a pair of parts, and its range in RANGES."""
RANGE = RecordView("RANGE", first_ball=word, ball_end=word)
"""A range of consecutive spheres."""
PLACED_BODY = RecordView("PLACED_BODY", count=word, parts=word)
"""How often a body was placed, and the count at which its parts' coarse spheres were last placed."""
PLACED_PART = RecordView("PLACED_PART", balls=word, cores=word)
"""The counts of a part's body at which the part's spheres and cores were last placed."""
PLACED_CORE = RecordView(
    "PLACED_CORE", center=3 * lanes, z_axis=3 * lanes, x_axis=3 * lanes, y_axis=3 * lanes
)
"""A core's pose in the world, in lanes."""
LANE_POSE = RecordView("LANE_POSE", rotation=9 * lanes, origin=3 * lanes)
"""A body's pose in lanes: rotation row by row, then origin."""
POSE = RecordView("POSE", center=3 * double, x_axis=3 * double, y_axis=3 * double, z_axis=3 * double)
"""A solid's pose in the world."""
SOLID = RecordView("SOLID", kind=double, radius=double, bounding=double, filled=double)
"""A solid: kind of its core, radius around it, bounding radius, whether it is filled."""
VECTORS = RecordView("VECTORS", xyz=3 * double)
"""Vectors: points, directions or half lengths."""


@compiled(inline=True, lean=True)
def dot(x: Any, y: Any, z: Any, axis: tuple[Any, Any, Any]) -> Any:
    """Return the scalar product of (x, y, z) and another vector."""
    return x * axis[0] + y * axis[1] + z * axis[2]


@compiled(inline=True, lean=True)
def between(place: int, other: int) -> tuple[float, float, float]:
    """Return the vector from the second point to the first, both given by address."""
    a, b = VECTORS.xyz(place), VECTORS.xyz(other)
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
