import numpy as np
import pytest
from robots import NAMES, load_example, loaded


@pytest.fixture(scope="session", params=NAMES)
def robot(request):
    return loaded(request.param)


@pytest.fixture(scope="session", params=["pepper-fixed-locked", "pepper-planar-mimic", "panda", "odd"])
def small_robot(request):
    return loaded(request.param)


def states(pepper, seed=0):
    """Random states, and the extremes: at limits, at rest, very fast, and with all joints in line."""
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(pepper.lower_limits, -3, 3), np.clip(pepper.upper_limits, -3, 3)
    n = pepper.n

    def anywhere():
        return rng.uniform(lower, upper)

    zero = np.zeros(n)
    return {
        "random": (anywhere(), rng.normal(size=n) * 3, rng.normal(size=n) * 10),
        "random again": (anywhere(), rng.normal(size=n), rng.normal(size=n)),
        "lower limits at rest": (lower, zero, zero),
        "upper limits, fast": (upper, rng.normal(size=n) * 1e3, rng.normal(size=n)),
        "in line": (zero, rng.normal(size=n), rng.normal(size=n)),
        "nearly in line": (zero + 1e-9, rng.normal(size=n) * 1e3, rng.normal(size=n) * 1e4),
        "quarter turns": (zero + np.pi / 2, rng.normal(size=n), zero),
        "many turns": (zero + 1e3, rng.normal(size=n), rng.normal(size=n)),
    }


@pytest.fixture(name="load_example")
def load_example_fixture():
    return load_example


@pytest.fixture(name="states")
def states_fixture():
    return states
