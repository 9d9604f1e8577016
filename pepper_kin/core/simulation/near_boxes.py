"""Fast test of spheres near boxes, before distances are measured."""

from __future__ import annotations

from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints2


class Boxes(NamedTuple):
    """Boxes in the world, each grown by a distance.

    Attributes:
        pose: Pose of each box's frame, transform_frame_to_world, shape (m, 4, 4).
        middle: Center of each box in its frame [m], shape (m, 3).
        half: Half lengths along the axes of the frame [m], may be infinite, shape (m, 3).
        grown: Distance by which each box is grown [m], shape (m,).
    """

    pose: Floats3
    middle: Floats2
    half: Floats2
    grown: Floats1


@compiled("int64(float64[:, ::1], Boxes, int64[:, ::1])")
def balls_near_boxes(balls: Floats2, boxes: Boxes, pairs: Ints2) -> int:
    """Find the spheres that reach grown boxes.

    Args:
        balls: Centers and radii [m], shape (k, 4).
        boxes: The boxes.
        pairs: Output: sphere and box, in the order of the spheres, shape (k m, 2).

    Returns:
        Number of pairs.
    """
    count = 0
    for ball in range(balls.shape[0]):
        for box in range(boxes.grown.size):
            pose, square = boxes.pose[box], 0.0
            x, y, z = (
                balls[ball, 0] - pose[0, 3],
                balls[ball, 1] - pose[1, 3],
                balls[ball, 2] - pose[2, 3],
            )
            for axis in range(3):
                place = x * pose[0, axis] + y * pose[1, axis] + z * pose[2, axis] - boxes.middle[box, axis]
                beyond = max(abs(place) - boxes.half[box, axis], 0.0)
                square += beyond * beyond
            reach = balls[ball, 3] + boxes.grown[box]
            if not square > reach * reach:
                pairs[count, 0], pairs[count, 1] = ball, box
                count += 1
    return count
