"""Closed meshes from grids of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError

from .mesh import Mesh

Array = NDArray[np.float64]


def _quads(index: NDArray[np.int64], points: Array) -> NDArray[np.int64]:
    """Split every cell of a grid along its shorter diagonal; return the triangles, shape (2 cells, 3).

    Args:
        index: Indices of the grid's points, shape (m, n).
        points: All points [m], shape (k, 3).
    """
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    a, b, c, d = (corner.ravel() for corner in (a, b, c, d))
    first = np.linalg.norm(points[a] - points[c], axis=1)
    second = np.linalg.norm(points[b] - points[d], axis=1)
    # The margin keeps the choice the same on both sides of a mirror and on every machine.
    along_ac = (first <= second + 1e-7)[:, None]
    one = np.where(along_ac, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    two = np.where(along_ac, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return np.concatenate([one, two])


def rings_to_mesh(rings: Array, first_pole: Array, last_pole: Array) -> Mesh:
    """Close a stack of rings with a fan at either end.

    Args:
        rings: Points [m], shape (m, n, 3), counter-clockwise seen from the far end of the stack's axis.
        first_pole: Point that closes the first ring [m], shape (3,).
        last_pole: Point that closes the last ring [m], shape (3,).
    """
    m, n = rings.shape[:2]
    if m < 1 or n < 3:
        raise InvalidValueError("rings", f"shape {rings.shape}", "at least one ring of three points")
    points = np.concatenate([rings.reshape(-1, 3), first_pole[None], last_pole[None]])
    index = np.arange(m * n).reshape(m, n)
    wrapped = np.concatenate([index, index[:, :1]], axis=1)
    bottom = np.stack([np.full(n, m * n), wrapped[0, 1:], wrapped[0, :-1]], axis=1)
    top = np.stack([np.full(n, m * n + 1), wrapped[-1, :-1], wrapped[-1, 1:]], axis=1)
    return Mesh(points, np.concatenate([bottom, _quads(wrapped, points), top]))


def plate(outer: Array, inner: Array, hub: Array) -> Mesh:
    """Close a grid into a curved plate: a wall along its border, a hidden fan behind it.

    Args:
        outer: Points of the visible side [m], shape (m, n, 3); seen from outside, columns run right and
            rows run up.
        inner: The same points on the hidden side [m], shape (m, n, 3); only the border counts.
        hub: Where the hidden fan meets [m], shape (3,).
    """
    if outer.shape != inner.shape or outer.ndim != 3 or min(outer.shape[:2]) < 2:
        raise InvalidValueError("outer, inner", f"{outer.shape}, {inner.shape}", "equal shapes (m, n, 3)")
    m, n = outer.shape[:2]
    index = np.arange(m * n).reshape(m, n)
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    points = np.concatenate([outer.reshape(-1, 3), inner.reshape(-1, 3)[border], hub[None]])
    rim, below = np.append(border, border[0]), m * n + np.append(np.arange(len(border)), 0)
    fan = np.stack([np.full(len(border), len(points) - 1), below[1:], below[:-1]], axis=1)
    faces = [_quads(index, points), _quads(np.stack([below, rim]), points), fan]
    return Mesh(points, np.concatenate(faces))


def disc(outer: Array, rim: Array, outer_center: Array, inner_center: Array) -> Mesh:
    """Close a polar grid into a curved disc with a hidden fan behind it.

    Args:
        outer: Rings of the visible side [m], from the middle outwards, shape (m, n, 3), counter-clockwise
            seen from outside.
        rim: The border of the hidden side [m], shape (n, 3).
        outer_center: Middle of the visible side [m], shape (3,).
        inner_center: Middle of the hidden side [m], shape (3,).
    """
    return rings_to_mesh(np.concatenate([rim[None], outer[::-1]]), inner_center, outer_center)


def hoop(outer: Array, inner: Array) -> Mesh:
    """Close two grids that go around (last column next to the first) into a ring.

    Args:
        outer: Rings of the visible side [m], from the middle outwards, shape (m, n, 3), counter-clockwise
            seen from outside.
        inner: The same for the hidden side, shape (k, n, 3), of which only first and last ring count.
    """
    loops = np.concatenate([inner[[0, -1]], outer[::-1]])
    points = loops.reshape(-1, 3)
    index = np.arange(len(points)).reshape(loops.shape[:2])
    closed = np.concatenate([index, index[:1]])
    return Mesh(points, _quads(np.concatenate([closed, closed[:, :1]], axis=1), points))
