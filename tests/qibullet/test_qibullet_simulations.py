"""Simulations of the adapter: several at once, several robots, their end, and the page in the browser."""

import numpy as np
import pytest

from pepper_kin.qibullet import (
    Camera,
    NaoVirtual,
    PepperRosWrapper,
    PepperVirtual,
    RobotVirtual,
    SimulationError,
    SimulationManager,
    UnsimulatedError,
)


def test_numbers_are_the_smallest_that_are_free(manager):
    clients = [manager.launchSimulation(gui=False, auto_step=False) for _ in range(3)]
    assert clients == [0, 1, 2]
    manager.stopSimulation(1)
    manager.stopSimulation(1)
    assert manager.launchSimulation(gui=False, auto_step=False) == 1
    for client in clients:
        manager.stopSimulation(client)
    assert manager.getGravity(0) is None


def test_robots_of_one_and_of_two_simulations_move_by_themselves(manager):
    one, two = (manager.launchSimulation(gui=False, auto_step=False) for _ in range(2))
    first, second = manager.spawnPepper(one), manager.spawnPepper(one, [2.0, 0.0, 0.0])
    third = manager.spawnPepper(two)
    assert len({first.getRobotModel(), second.getRobotModel()}) == 2
    first.setAngles("HeadYaw", 0.5, 1.0)
    second.setAngles("HeadYaw", -0.5, 1.0)
    third.setAngles("HeadYaw", 0.2, 1.0)
    for _ in range(480):
        manager.stepSimulation(one)
    yaws = [robot.getAnglesPosition("HeadYaw") for robot in (first, second, third)]
    np.testing.assert_allclose(yaws[:2], [0.5, -0.5], atol=5e-3)
    assert abs(yaws[2]) < 0.02  # nobody stepped the second simulation
    assert second.getPosition()[0] == pytest.approx(2.0, abs=1e-3)
    manager.removePepper(first)
    with pytest.raises(SimulationError, match=r"no robot 1 in simulation 0; there are: 2"):
        manager.removePepper(first)
    manager.stopSimulation(one)
    manager.stopSimulation(two)


def test_the_wall_clock_drives_what_steps_itself(manager):
    client = manager.launchSimulation(gui=False)
    pepper = manager.spawnPepper(client)
    pepper.setAngles("HeadYaw", 0.4, 1.0)
    body = pepper.body
    assert body.time.wait_until(lambda: not list(body.tasks), timeout=20.0)
    assert pepper.getAnglesPosition("HeadYaw") == pytest.approx(0.4, abs=0.03)
    manager.stopSimulation(client)


def test_cameras_end_with_the_robot_and_the_simulation(manager):
    client = manager.launchSimulation(gui=False, auto_step=False)
    for end in (manager.resetSimulation, manager.stopSimulation):
        pepper = manager.spawnPepper(client)
        camera = pepper.getCamera(pepper.subscribeCamera(PepperVirtual.ID_CAMERA_TOP, Camera.K_QQVGA))
        pepper.subscribeImu()
        end(client)
        assert not camera.isActive()
        assert not pepper.getImu().isAlive()


def test_calls_to_what_is_not_there_name_it(manager):
    for call in (
        lambda: manager.stepSimulation(7),
        lambda: manager.spawnPepper(-1),
        lambda: manager.setGravity(None, [0, 0, -9.81]),
        lambda: manager.resetSimulation("0"),
    ):
        with pytest.raises(SimulationError, match="physics client: no simulation"):
            call()


def test_wrong_values_name_the_quantity(manager, client):
    for gravity in ([0.0, 0.0], "down", [0.0, 0.0, float("nan")]):
        with pytest.raises(SimulationError, match="gravity: got"):
            manager.setGravity(client, gravity)
    with pytest.raises(SimulationError, match="light_position: got"):
        manager.setLightPosition(client, [1, 2, 3, 4])
    manager.setLightPosition(client, [1, 2, 3])


def test_other_robots_are_refused_by_name(manager, client):
    for make, words in (
        (lambda: manager.spawnNao(client), "NAO is not simulated"),
        (lambda: manager.spawnRomeo(client), "Romeo is not simulated"),
        (NaoVirtual, "NAO is not simulated"),
        (PepperRosWrapper, "ROS 2"),
        (lambda: PepperVirtual().getFsrValue("LFsrFL_frame"), "Pepper has wheels"),
    ):
        with pytest.raises(UnsimulatedError, match=words):
            make()
    with pytest.raises(SimulationError, match=r"there is no file 'nowhere\.urdf'"):
        RobotVirtual("nowhere.urdf").loadRobot([0, 0, 0], [0, 0, 0, 1])
    with pytest.raises(SimulationError, match="not loaded"):
        PepperVirtual().getPosition()


def test_errors_are_those_of_pybullet():
    """Scripts write `except pybullet.error`; the classes of both must be one another's children."""
    bullet = pytest.importorskip("pybullet")  # no wheels for Python 3.12 and later
    with pytest.raises(bullet.error):
        SimulationManager().stepSimulation(99)


@pytest.mark.thorough
def test_the_adapter_needs_no_pybullet(child):
    code = (
        "import sys; sys.modules['pybullet'] = None\n"
        "import importlib.util as u; find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'pybullet' else find(name, *a)\n"
        "from pepper_kin.qibullet import SimulationManager, SimulationError\n"
        "try: SimulationManager().stepSimulation(99)\n"
        "except SimulationError as error: print(isinstance(error, RuntimeError))\n"
    )
    assert child(code).stdout == "True\n"


@pytest.mark.thorough
def test_a_page_follows_the_robot(manager, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    client = manager.launchSimulation(gui=True, auto_step=False)
    pepper = manager.spawnPepper(client)
    try:
        pepper.setAngles("HeadYaw", 0.7, 1.0)
        for _ in range(480):
            manager.stepSimulation(client)
        (page,) = client_pages(client)
        assert opened == [page.url]
        np.testing.assert_allclose(page.viewer.q, pepper.body.configuration(True), atol=5e-3)
        assert page.viewer.q[pepper.body.index["HeadYaw"]] == pytest.approx(0.7, abs=5e-3)
    finally:
        manager.stopSimulation(client)
    assert page.viewer.url is None


def client_pages(client):
    from pepper_kin.qibullet.simulation import simulation_of

    return simulation_of(client)._pages.values()
