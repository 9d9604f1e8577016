"""A simulated robot whose time passes by waiting, fresh for each test."""

import pytest

from pepper_kin.naoqi import Broker


@pytest.fixture
def broker():
    with Broker(real_time=False) as made:
        yield made


@pytest.fixture
def motion(broker):
    return broker.motion
