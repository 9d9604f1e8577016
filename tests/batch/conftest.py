import numpy as np
import pytest
from robots import NAMES, loaded


@pytest.fixture(scope="session", params=NAMES)
def robot(request):
    return loaded(request.param)


@pytest.fixture(scope="session", params=["pepper-fixed-locked", "panda", "odd"])
def small_robot(request):
    return loaded(request.param)


@pytest.fixture(scope="session")
def panda():
    return loaded("panda")


@pytest.fixture
def states():
    """Positions, velocities and a third vector of 56 states of a robot, ordinary and extreme."""

    def make(robot, seed=0):
        rng = np.random.default_rng(seed)
        n = robot.n
        lower, upper = np.clip(robot.lower_limits, -3, 3), np.clip(robot.upper_limits, -3, 3)
        inside = rng.uniform(lower, upper, (8, n))
        normal = rng.normal(size=(8, n))
        zero = np.zeros((8, n))
        q = [inside, np.tile(lower, (8, 1)), np.tile(upper, (8, 1)), zero, 1e-9 * normal, inside, inside]
        # Limits at rest, straight limbs (singular for the hands) and nearly straight ones, 1e3 rad/s.
        v = [normal, zero, rng.normal(size=(8, n)), normal, normal, 1e3 * normal, zero]
        a = [3 * normal, zero, normal, normal, rng.normal(size=(8, n)), 1e4 * normal, normal]
        return np.concatenate(q), np.concatenate(v), np.concatenate(a)

    return make
