"""A motion that several tests write and read."""

import numpy as np
import pytest

import pepper_kin as pk


@pytest.fixture(scope="module")
def trajectory(pepper):
    q = pepper.posture("Stand")
    return pk.retime(pepper, [q, q + 0.1 * (np.arange(pepper.n) % 3 == 2)])
