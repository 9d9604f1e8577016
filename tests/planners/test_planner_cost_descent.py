"""Paths of low cost: catenaries, shortest ways on a grid, spheres, obstacles."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners import ConstraintManifold, Path, Problem, StateCost, descend_cost

FREE = lambda x: np.ones(len(x), dtype=bool)  # noqa: E731


def problem(start, goal, valid=FREE, resolution=0.01, weights=None, low=-2.0, high=2.0):
    n = len(start)
    return Problem([low] * n, [high] * n, start, [goal], valid, resolution=resolution, weights=weights)


def hill(center, height, width):
    """Return a Gaussian price and its gradient."""

    def evaluate(x):
        apart = x - np.asarray(center)
        price = height * np.exp(-np.sum(apart**2, axis=1) / (2 * width**2))
        return price[:, None], (-apart / width**2 * price[:, None])[:, None]

    return evaluate


def refined(path, cost):
    return cost.along(path.resample(0.002))


@pytest.mark.parametrize("a", [1.2, 1.5, 3.0])
def test_where_the_price_rises_with_height_the_path_is_a_catenary(a):
    """The integral of y ds between (-1, y0) and (1, y0) is least on y = a cosh(x / a)."""
    cost = StateCost(lambda x: (x[:, 1:] - 1.0, np.tile([0.0, 1.0], (len(x), 1, 1))), 2)
    start, goal = [-1.0, a * math.cosh(1 / a)], [1.0, a * math.cosh(1 / a)]
    space = problem(start, goal, low=-4.0, high=4.0)
    corner = Path([start, [0.3, start[1] + 0.2], goal])
    found = descend_cost(space, cost, corner, timeout=10)
    x, y = found.points.T
    np.testing.assert_allclose(y, a * np.cosh(x / a), atol=0.004)
    least = a * (1 + a / 2 * math.sinh(2 / a))
    assert refined(found, cost) == pytest.approx(least, rel=1e-4)
    np.testing.assert_array_equal(found.points[[0, -1]], [start, goal])


def cheapest_on_a_grid(cost, start, goal, spacing=0.01, reach=4):
    """Return the least integral of 1 + c over polylines on a grid of [0, 1]^2."""
    count = round(1 / spacing) + 1
    x = np.linspace(0, 1, count)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1)
    price = 1 + cost.at(grid.reshape(-1, 2)).reshape(count, count)
    number = np.arange(count * count).reshape(count, count)
    rows, columns, lengths = [], [], []
    for i in range(-reach, reach + 1):
        for j in range(reach + 1):
            if math.gcd(i, j) != 1:
                continue
            here = slice(max(0, -i), count - max(0, i)), slice(0, count - j)
            there = slice(max(0, i), count + min(0, i)), slice(j, count)
            rows.append(number[here].ravel())
            columns.append(number[there].ravel())
            lengths.append((math.hypot(i, j) * spacing * (price[here] + price[there]) / 2).ravel())
    edges = np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))
    first, last = (number[tuple(np.round(np.array(p) / spacing).astype(int))] for p in (start, goal))
    return dijkstra(coo_matrix(edges, shape=(count**2, count**2)), directed=False, indices=first)[last]


@pytest.mark.parametrize("place", [0.35, 0.45, 0.65])
@pytest.mark.parametrize("height", [1.0, 5.0, 20.0])
def test_round_a_hill_as_cheap_as_any_way_on_a_grid(place, height):
    cost = StateCost(hill([0.5, place], height, 0.12), 2)
    start, goal = [0.1, 0.5], [0.9, 0.5]
    found = descend_cost(problem(start, goal, low=0.0, high=1.0), cost, Path([start, goal]), timeout=10)
    least = cheapest_on_a_grid(cost, start, goal)  # polylines on a grid: up to 1 % above the least
    assert refined(found, cost) <= 1.005 * least
    assert refined(found, cost) < cost.along(Path([start, goal]).resample(0.002))


@pytest.mark.thorough
def test_without_a_price_the_path_becomes_short():
    wall = lambda x: ~((np.abs(x[:, 0]) < 0.1) & (x[:, 1] < 0.5))  # noqa: E731
    space = problem([-1.0, 0.0], [1.0, 0.0], wall)
    free = StateCost(lambda x: (np.zeros((len(x), 1)), np.zeros((len(x), 1, 2))), 2)
    way = Path([[-1.0, 0.0], [-1.0, 1.5], [1.0, 1.5], [1.0, 0.0]])
    found = descend_cost(space, free, way, shortcuts=300, timeout=10)
    shortest = 2 * math.hypot(0.9, 0.5) + 0.2
    assert shortest - 0.02 <= found.length <= 1.05 * shortest
    assert wall(found.resample(0.01).points).mean() > 0.97  # edges are checked every centimeter


def test_obstacles_are_kept_clear_of():
    ball = lambda x: np.linalg.norm(x - [0.0, 0.35], axis=1) > 0.3  # noqa: E731
    cost = StateCost(hill([0.0, 0.0], 10.0, 0.3), 2)
    start, goal = [-1.0, 0.02], [1.0, 0.02]
    space = problem(start, goal, ball)
    found = descend_cost(space, cost, Path([start, goal]), timeout=10)
    assert ball(found.resample(0.01).points).all()
    assert refined(found, cost) < refined(Path([start, goal]), cost)


def test_weights_scale_lengths():
    """What a metric scales is the same path in scaled coordinates."""
    scale = np.array([2.0, 0.5])
    plain = hill([0.5, 0.45], 5.0, 0.15)

    def scaled(x):
        price, slope = plain(x * scale)
        return price, slope * scale

    start, goal = np.array([0.1, 0.5]), np.array([0.9, 0.5])
    one = descend_cost(problem(start, goal), StateCost(plain, 2), Path([start, goal]), timeout=10)
    space = problem(start / scale, goal / scale, weights=scale)
    way = Path([start / scale, goal / scale], scale)
    other = descend_cost(space, StateCost(scaled, 2), way, timeout=10)
    np.testing.assert_allclose(other.points * scale, one.points, atol=1e-9)


@pytest.mark.thorough
def test_on_a_sphere_points_stay_on_it():
    def radius(x):
        length = np.linalg.norm(x, axis=1)
        return (length - 1.0)[:, None], (x / length[:, None])[:, None]

    sphere = ConstraintManifold(radius, 3, 1, 1e-3)
    # High up is dear: the great circle through the pole is left for a way along the side.
    cost = StateCost(
        lambda x: (
            8 * np.maximum(x[:, 2:], 0) ** 2,
            16 * np.maximum(x[:, 2], 0)[:, None, None] * [0, 0, 1.0],
        ),
        3,
    )
    angle = np.linspace(-1.2, 1.2, 200)
    way = np.stack([np.sin(angle), 0.05 * np.cos(angle), np.cos(angle)], axis=1)
    way /= np.linalg.norm(way, axis=1)[:, None]
    space = problem(way[0], way[-1], resolution=0.03)
    found = descend_cost(space, cost, Path(way), manifold=sphere, iterations=300, timeout=20)
    assert sphere.worst(found.points) <= 1.0
    assert sphere.worst(found.resample(0.003).points) <= 1.0
    assert np.diff(found.arc_lengths).max() <= 0.03
    assert cost.along(found) < 0.6 * cost.along(Path(way))
    assert found.points[len(found) // 2, 2] < 0.5


def test_a_price_that_is_no_number_is_kept_clear_of():
    def price(x):
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(x[:, 1:] + 1e-9) ** 2, 2 * np.log(x[:, 1:] + 1e-9)[:, None] / x[:, None] * [0, 1.0]

    cost, start, goal = StateCost(price, 2), [0.0, 0.5], [1.0, 0.5]
    found = descend_cost(problem(start, goal), cost, Path([start, goal]), timeout=10)
    assert np.isfinite(cost.along(found))
    assert found.points[:, 1].max() > 0.6
    low = Path([start, [0.5, -0.5], goal])
    assert descend_cost(problem(start, goal), cost, low) is low


def test_the_same_seed_gives_the_same_path():
    cost, way = StateCost(hill([0.5, 0.4], 5.0, 0.2), 2), Path([[0.0, 0.5], [0.3, 1.0], [1.0, 0.5]])
    space = problem(way.points[0], way.points[-1])
    runs = [descend_cost(space, cost, way, seed=seed, timeout=60).points for seed in (3, 3, 4)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_what_a_price_raises_is_raised_and_misfits_are_refused():
    def fails(x):
        raise ZeroDivisionError("the price")

    way = Path([[0.0, 0.5], [1.0, 0.5]])
    with pytest.raises(ZeroDivisionError, match="the price"):
        descend_cost(problem(*way.points), StateCost(fails, 2), way)
    flat = StateCost(hill([0, 0, 0], 1.0, 1.0), 3)
    with pytest.raises(InvalidValueError, match="3 coordinates"):
        descend_cost(problem(*way.points), flat, way)
    with pytest.raises(InvalidValueError, match="iterations"):
        descend_cost(problem(*way.points), StateCost(fails, 2), way, iterations=-1)
