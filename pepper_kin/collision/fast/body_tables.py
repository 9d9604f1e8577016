"""Tables of a robot's bodies: their joints, their spheres and cores in groups and parts, their pairs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.fast.ball_cover import ball_cover
from pepper_kin.collision.fast.solids import Solid
from pepper_kin.collision.fast.structure import ComparedParts, ball_order, bounding_ball
from pepper_kin.core.collision.ball_check import BLOCK, POINT, SEGMENT
from pepper_kin.core.collision.layout import CLOUD, CYLINDER, HULL
from pepper_kin.core.collision.records import (
    BALL,
    BODY,
    CORE,
    FRAME,
    GROUP,
    LINK,
    LINK_PART,
    PART,
    RANGE,
    SIDE,
)
from pepper_kin.core.collision.scene_rows import NO_INNER
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.tree import read_frames

_BODY = BODY.columns

MOST_BALLS = 8
"""Maximum number of spheres in a part of a body that has several parts, unless they are of one solid."""


class BodyTables:
    """Tables of bodies, groups, spheres, cores and pairs; the world is the last body."""

    def __init__(self, pepper: PepperModel, structure: ComparedParts) -> None:
        self._structure, self._tree = structure, read_frames(pepper, compact=True)
        tree, solids = self._tree, structure.solids
        count = len(tree.bodies)
        self.bodies = np.zeros((count + 1, BODY.width), np.int64)
        self.frames = np.zeros((count + 1, FRAME.width))
        self._balls: list[Array] = []
        self._parts: list[list[int]] = []
        self._parts_of: dict[int, tuple[int, int]] = {}
        self._part_of: dict[int, int] = {}
        self._ball_counts: list[int] = []
        self._core_counts: list[int] = []
        self._cores: list[list[float]] = []
        self._range_of: dict[int, tuple[int, int]] = {}
        self._cores_of: dict[int, tuple[int, int]] = {}
        groups_of: dict[int, list[int]] = {}
        for g, members in enumerate(structure.groups):
            groups_of.setdefault(solids[members[0]].joint, []).append(g)
        rows = full_rows(pepper)
        for b in range(count + 1):
            joint = b + 1 if b < count else 0
            if b < count:
                body = tree.bodies[b]
                source, gain, offset = rows[b]
                own = self.bodies[b]
                own[_BODY.parent], own[_BODY.slides] = body.parent + 1, body.slides
                own[_BODY.coordinate], own[_BODY.moves] = source, 1
                rotation = np.array(body.rotation, dtype=float)
                origin = np.array(body.translation, dtype=float)
                self.frames[b] = FRAME.row(rotation=rotation, origin=origin, gain=gain, offset=offset)
            self._add_body(b, [i for i, s in enumerate(solids) if s.joint == joint], groups_of.get(joint, []))
        self.groups = np.array([self._group(g) for g in range(len(structure.groups))], np.int64).reshape(
            -1, GROUP.width
        )
        self.parts = np.array(self._parts, np.int64).reshape(-1, PART.width)
        place = 0
        for b in range(count + 1):
            joint = b + 1 if b < count else 0
            self.bodies[b, _BODY.first_group] = place
            place += len(groups_of.get(joint, []))
            self.bodies[b, _BODY.group_end] = place
        self.balls = np.array(self._balls).reshape(-1, BALL.width)
        self.cores = np.array(self._cores).reshape(-1, CORE.width)
        self.links, self.link_parts, self.sides, self.ranges = self._pairs()
        of_bodies = np.repeat(np.arange(count + 1), self._ball_counts)
        self.ball_bodies = np.concatenate([of_bodies, self.groups[:, GROUP.columns.body]])
        self.core_bodies = np.repeat(np.arange(count + 1), self._core_counts)

    def _local(self, solid: Solid, points: Any) -> Array:
        """Return points, shape (k, 3), in the frame of a solid's joint converted to the frame of its body."""
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        if solid.joint == 0:
            return points
        alignment = self._tree.alignments[solid.joint - 1]
        return np.asarray((points - alignment.origin) @ alignment.rotation)

    def _bounding(self, solids: tuple[Solid, ...]) -> Array:
        """Return the row of a bounding sphere of solids of one joint."""
        center, radius = bounding_ball(solids)
        return np.array(BALL.row(center=self._local(solids[0], center)[0], outer=radius, inner=NO_INNER))

    def _add_body(self, b: int, own: list[int], groups: list[int]) -> None:
        """Add the spheres, parts and cores of body b, for its solids and its groups."""
        solids = self._structure.solids
        none = np.array(BALL.row(center=np.zeros(3), outer=NO_INNER, inner=NO_INNER))
        self.bodies[b, _BODY.coarse] = len(self._balls)
        self._balls.append(self._bounding(tuple([solids[i] for i in own])) if own else none)
        in_groups = [self._structure.groups[g] for g in groups]
        rest = tuple(i for i in own if not any(i in group for group in in_groups))
        cuts = [self._cut(members) for members in (*in_groups, rest) if members]
        alone, first_core = sum(map(len, cuts)) == 1, len(self._cores)
        self.bodies[b, _BODY.first_part] = len(self._parts)
        for parts, group in zip(cuts, [*groups, -1], strict=False):
            first_part = len(self._parts)
            if len(parts) > 1 and group >= 0:
                self._parts.append([0] * PART.width)  # the whole group, whose coarse sphere is added later
            for part in parts:
                coarse = self.bodies[b, _BODY.coarse] if alone else len(self._balls)
                if not alone:
                    self._balls.append(self._bounding(tuple([solids[i] for i in part])))
                self._add_part(coarse, part)
            self._parts_of[group] = first_part, len(self._parts)
        self.bodies[b, _BODY.part_end] = len(self._parts)
        self._ball_counts.append(len(self._balls) - int(self.bodies[b, _BODY.coarse]))
        self._core_counts.append(len(self._cores) - first_core)

    def _add_part(self, coarse: int, part: tuple[int, ...]) -> None:
        """Add a part of a body, with the spheres and cores of its solids."""
        balls, cores = len(self._balls), len(self._cores)
        for i in part:
            solid, first, first_core = self._structure.solids[i], len(self._balls), len(self._cores)
            cover = ball_cover(solid)
            inner = np.where(cover.inner > 0.0, cover.inner, NO_INNER)
            for row in zip(self._local(solid, cover.centers), cover.outer, inner, strict=True):
                self._balls.append(np.array(BALL.row(center=row[0], outer=row[1], inner=row[2])))
            self._range_of[i], self._part_of[i] = (first, len(self._balls)), len(self._parts)
            self._cores += self._cores_of_solid(i)
            self._cores_of[i] = first_core, len(self._cores)
        ends = {"ball_end": len(self._balls), "core_end": len(self._cores)}
        self._parts.append(PART.row(coarse=coarse, first_ball=balls, first_core=cores, **ends))

    def _cut(self, members: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Return parts of some solids of a joint, each of few spheres that are near one another."""
        solids = [self._structure.solids[i] for i in members]
        if len(members) == 1 or sum(len(ball_cover(solid).outer) for solid in solids) <= MOST_BALLS:
            return [members]
        centers = np.array([ball_cover(solid).centers.mean(axis=0) for solid in solids])
        axis = int(np.argmax(np.ptp(centers, axis=0)))
        order, half = np.argsort(centers[:, axis], kind="stable").tolist(), (len(members) + 1) // 2
        return [
            part
            for some in (order[:half], order[half:])
            for part in self._cut(tuple(members[k] for k in some))
        ]

    def _cores_of_solid(self, i: int) -> list[list[float]]:
        """Return the rows of a solid in CORES: a segment, a box, or its spheres as points."""
        solid = self._structure.solids[i]
        if solid.kind in (HULL, CYLINDER, CLOUD):
            own = BALL.columns
            return [
                _core(POINT, (row[own.outer], row[own.inner]), np.zeros(3), row[own.center], np.eye(3))
                for row in self._balls[slice(*self._range_of[i])]
            ]
        kind = BLOCK if not solid.segment else SEGMENT if solid.half[2] > 0.0 else POINT
        turn = np.eye(3) if solid.joint == 0 else self._tree.alignments[solid.joint - 1].rotation
        center = self._local(solid, solid.position)[0]
        radii = solid.radius, solid.radius if solid.filled else NO_INNER
        return [_core(kind, radii, solid.half, center, (turn.T @ solid.rotation).T)]

    def _group(self, g: int) -> list[int]:
        """Return the row of a group, whose coarse sphere is added."""
        solids = tuple([self._structure.solids[i] for i in self._structure.groups[g]])
        body = solids[0].joint - 1 if solids[0].joint else len(self._tree.bodies)
        coarse, (first, end) = len(self._balls), self._parts_of[g]
        self._balls.append(self._bounding(solids))
        if end - first > 1:
            self._parts[first][PART.columns.coarse] = coarse
        first_ball = self._parts[first + (end - first > 1)][PART.columns.first_ball]
        rest = {"ball_end": self._parts[end - 1][PART.columns.ball_end], "first_part": first, "part_end": end}
        return GROUP.row(body=body, coarse=coarse, first_ball=first_ball, checked=1, **rest)

    def _pairs(self) -> tuple[NDArray[np.int64], ...]:
        """Return the sections LINKS, LINK_PARTS, SIDES and RANGES."""
        solids, world = self._structure.solids, len(self._tree.bodies)
        links: list[list[int]] = []
        parts: list[list[int]] = []
        sides: list[list[int]] = []
        ranges: list[list[int]] = []
        order = [ball_order(solid) for solid in solids]
        for c, pairs in enumerate(self._structure.classes):
            by_bodies: dict[tuple[int, int], dict[tuple[int, int], dict[int, list[int]]]] = {}
            for i, j in pairs:
                covered, exact = (i, j) if order[i] <= order[j] else (j, i)
                a, b = ((solids[k].joint - 1) % (world + 1) for k in (covered, exact))
                both = self._part_of[covered], self._part_of[exact]
                by_bodies.setdefault((a, b), {}).setdefault(both, {}).setdefault(exact, []).append(covered)
            for (a, b), by_parts in by_bodies.items():
                first_part = len(parts)
                for both, by_exact in by_parts.items():
                    first_side = len(sides)
                    for exact, all_covered in by_exact.items():
                        first = len(ranges)
                        for begin, end in sorted(self._range_of[k] for k in all_covered):
                            if len(ranges) > first and ranges[-1][RANGE.columns.ball_end] == begin:
                                ranges[-1][RANGE.columns.ball_end] = end
                            else:
                                ranges.append(RANGE.row(first_ball=begin, ball_end=end))
                        for core in range(*self._cores_of[exact]):
                            sides.append(SIDE.row(core=core, first_range=first, range_end=len(ranges)))
                    own = {"covered": both[0], "exact": both[1], "first_side": first_side}
                    parts.append(LINK_PART.row(**own, touching=0, side_end=len(sides)))
                coarse = self.bodies[[a, b], _BODY.coarse]
                balls = {"covered": a, "covered_coarse": coarse[0], "exact": b, "exact_coarse": coarse[1]}
                rest = {"touching": 0, "pair_class": c, "first_part": first_part, "part_end": len(parts)}
                links.append(LINK.row(**balls, **rest))
        shapes = (LINK.width, LINK_PART.width, SIDE.width, RANGE.width)
        return tuple(
            np.array(rows, np.int64).reshape(-1, width)
            for rows, width in zip((links, parts, sides, ranges), shapes, strict=True)
        )


def _core(kind: int, radii: tuple[float, float], half: Any, center: Array, axes: Array) -> list[float]:
    """Return a row of CORES; axes, shape (3, 3), are x, y and z."""
    of_axes = dict(zip(("x_axis", "y_axis", "z_axis"), axes, strict=True))
    return CORE.row(kind=kind, outer=radii[0], inner=radii[1], half=half, center=center, **of_axes)


def full_rows(pepper: PepperModel) -> Array:
    """Return for each coordinate of Pinocchio's model its index in q, gain and offset, shape (n_full, 3)."""
    gains, rows = np.asarray(pepper.full_map), np.zeros((len(pepper.full_offset), 3))
    rows[:, 0] = np.abs(gains).argmax(axis=1)
    rows[:, 1] = gains[np.arange(len(gains)), rows[:, 0].astype(int)]
    rows[:, 2] = pepper.full_offset
    return rows
