"""Toy worlds whose exact validity is known in closed form, for states and for whole edges."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from pepper_kin.kernels import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.planners import CompiledMotionValidator


@dataclass(frozen=True)
class World:
    """Solid boxes and balls in n dimensions; a state is free outside all of them."""

    box_lower: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    box_upper: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    centers: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    radii: np.ndarray = field(default_factory=lambda: np.empty(0))

    def free(self, states: np.ndarray) -> np.ndarray:
        return self.padded(0.0)(states)

    def padded(self, margin: float | np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        lower, upper, radii = self.box_lower - margin, self.box_upper + margin, self.radii + np.max(margin)

        def checker(states: np.ndarray) -> np.ndarray:
            free = np.ones(len(states), dtype=bool)
            for low, high in zip(lower, upper, strict=True):
                free &= ~np.all((states > low) & (states < high), axis=1)
            for center, radius in zip(self.centers, radii, strict=True):
                free &= np.linalg.norm(states - center, axis=1) > radius
            return free

        return checker

    def edge_free(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Exact test of a whole segment: clipping against each box, distance to each center."""
        d = b - a
        for low, high in zip(self.box_lower, self.box_upper, strict=True):
            enter, leave = 0.0, 1.0
            for i in range(len(a)):
                if abs(d[i]) < 1e-15:
                    if not low[i] < a[i] < high[i]:
                        leave = -1.0
                    continue
                t = sorted(((low[i] - a[i]) / d[i], (high[i] - a[i]) / d[i]))
                enter, leave = max(enter, t[0]), min(leave, t[1])
            if enter < leave - 1e-12:
                return False
        for center, radius in zip(self.centers, self.radii, strict=True):
            t = np.clip((center - a) @ d / max(d @ d, 1e-300), 0.0, 1.0)
            if np.linalg.norm(a + t * d - center) <= radius - 1e-12:
                return False
        return True

    def path_free(self, points: np.ndarray) -> bool:
        return all(self.edge_free(a, b) for a, b in pairwise(points))


def boxes(*pairs: tuple[object, object]) -> World:
    lower = np.array([low for low, _ in pairs], dtype=float)
    return World(lower, np.array([high for _, high in pairs], dtype=float), np.empty((0, lower.shape[1])))


@pytest.fixture
def wall() -> World:
    """A wall across the unit square with a gap from y = 0.45 to 0.55."""
    return boxes(([0.48, -1.0], [0.52, 0.45]), ([0.48, 0.55], [0.52, 2.0]))


@pytest.fixture
def closed_wall() -> World:
    return boxes(([0.45, -1.0], [0.55, 2.0]))


@pytest.fixture
def maze() -> World:
    """Four walls, open at the top and at the bottom in turn."""
    walls = []
    for k, x in enumerate((0.2, 0.4, 0.6, 0.8)):
        low, high = (-1.0, 0.8) if k % 2 == 0 else (0.2, 2.0)
        walls.append(([x - 0.02, low], [x + 0.02, high]))
    return boxes(*walls)


@pytest.fixture
def discs() -> World:
    centers = np.array([[0.35, 0.3], [0.6, 0.6], [0.3, 0.75], [0.75, 0.25]])
    return World(centers=centers, radii=np.array([0.14, 0.16, 0.12, 0.15]))


@pytest.fixture
def boxes_6d() -> World:
    """Random boxes in the unit cube of six dimensions, and one large one between the corners."""
    rng = np.random.default_rng(3)
    center, half = rng.uniform(0.2, 0.8, (12, 6)), rng.uniform(0.15, 0.3, (12, 6))
    center[0], half[0] = 0.5, 0.3
    keep = np.array(
        [all(np.any(abs(c - p) > h + 0.05) for p in (0.05, 0.95)) for c, h in zip(center, half, strict=True)]
    )
    return World((center - half)[keep], (center + half)[keep], np.empty((0, 6)))


@compiled("int64(int64, int64, int64, int64)", by_address=True)
def valid_steps(start, end, steps, table):  # type: ignore[no-untyped-def]
    """A `World` as machine code: its table holds n, the numbers of boxes and balls, and then these."""
    head = floats_at(table, 3)
    n, boxes, balls = int(head[0]), int(head[1]), int(head[2])
    a, b, memory = (
        floats_at(start, n),
        floats_at(end, n),
        floats_at(table, 3 + 2 * n * boxes + (n + 1) * balls),
    )
    for j in range(1, steps + 1):
        place = 3
        for _ in range(boxes):
            inside = True
            for i in range(n):
                x = b[i] if j == steps else a[i] + (b[i] - a[i]) * j / steps
                inside = inside and memory[place + i] < x < memory[place + n + i]
            if inside:
                return j - 1
            place += 2 * n
        for _ in range(balls):
            square = 0.0
            for i in range(n):
                x = b[i] if j == steps else a[i] + (b[i] - a[i]) * j / steps
                square += (x - memory[place + i]) ** 2
            if square <= memory[place + n] ** 2:
                return j - 1
            place += n + 1
    return steps


def machine_code_of(world: World, margin: float | np.ndarray = 0.0) -> CompiledMotionValidator:
    n = max(world.box_lower.shape[1], world.centers.shape[1])
    box_rows = np.hstack((world.box_lower - margin, world.box_upper + margin))
    ball_rows = np.column_stack((world.centers, world.radii + np.max(margin)))
    table = np.concatenate(([n, len(box_rows), len(ball_rows)], box_rows.ravel(), ball_rows.ravel()))
    return CompiledMotionValidator(valid_steps.address, n, table.copy, keep_alive=valid_steps)


@pytest.fixture
def machine_code() -> Callable[..., CompiledMotionValidator]:
    """Turns a world, grown by a margin, into an oracle that is machine code."""
    return machine_code_of


class Toy:
    """Makes worlds, and machine code of them."""

    code = staticmethod(machine_code_of)

    @staticmethod
    def world(lower: object = (), upper: object = (), centers: object = (), radii: object = ()) -> World:
        rows = [np.asarray(rows, dtype=float) for rows in (lower, upper, centers)]
        n = max(part.shape[1] for part in rows if part.size)
        return World(*(part.reshape(-1, n) for part in rows), np.asarray(radii, dtype=float))


@pytest.fixture
def toy() -> Toy:
    return Toy()


@pytest.fixture
def balls() -> Callable[[int], World]:
    """Balls in the unit cube of n dimensions, with one large one between two corners."""

    def make(n: int) -> World:
        rng = np.random.default_rng(n)
        centers = rng.uniform(0.1, 0.9, (20, n))
        far = np.min([np.linalg.norm(centers - p, axis=1) for p in (0.1, 0.9)], axis=0) > 0.35
        centers = np.vstack((centers[far], np.full(n, 0.5)))
        radii = np.full(len(centers), 0.3)
        radii[-1] = 0.35 * np.sqrt(n) / 1.5
        return World(np.empty((0, n)), np.empty((0, n)), centers, radii)

    return make
