"""A simulation whose time passes by steps and by waiting, and a Pepper in it."""

import pytest

from pepper_kin.qibullet import SimulationManager


@pytest.fixture
def manager():
    return SimulationManager()


@pytest.fixture
def client(manager):
    client = manager.launchSimulation(gui=False, auto_step=False)
    yield client
    manager.stopSimulation(client)


@pytest.fixture
def pepper(manager, client):
    return manager.spawnPepper(client)


@pytest.fixture
def steps(manager, client):
    """Let seconds pass."""

    def let_pass(seconds):
        for _ in range(round(240 * seconds)):
            manager.stepSimulation(client)

    return let_pass
