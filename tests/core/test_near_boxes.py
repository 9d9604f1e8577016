"""Balls near boxes, against the nearest of many points of each box."""

import numpy as np

from pepper_kin.core.simulation.near_boxes import Boxes, balls_near_boxes
from pepper_kin.model.shapes import transform


def test_pairs_are_those_that_the_nearest_points_reach():
    rng = np.random.default_rng(3)
    count = 12
    pose = np.array([transform(rng.normal(size=3), rng.uniform(-3, 3, 3)) for _ in range(count)])
    middle, half = rng.normal(size=(count, 3)) * 0.1, rng.uniform(0.1, 0.6, (count, 3))
    grown = rng.uniform(0, 0.1, count)
    half[0] = np.inf  # a half-space may be anywhere
    balls = np.column_stack([rng.normal(size=(40, 3)), rng.uniform(0.01, 0.5, 40)])
    pairs = np.zeros((40 * count, 2), np.int64)
    found = balls_near_boxes(balls, Boxes(pose, middle, half, grown), pairs)
    expected = []
    for ball in range(40):
        for box in range(count):
            local = pose[box, :3, :3].T @ (balls[ball, :3] - pose[box, :3, 3]) - middle[box]
            nearest = np.clip(local, -half[box], half[box])
            if np.linalg.norm(local - nearest) <= balls[ball, 3] + grown[box]:
                expected.append((ball, box))
    assert [tuple(pair) for pair in pairs[:found]] == expected
    assert 40 < found < 200
