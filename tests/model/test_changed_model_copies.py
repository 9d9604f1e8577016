"""Changed limits and masses survive copies, pickles, other processes and the search for a base place."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk

PEPPER = pk.load_pepper()
Q = PEPPER.posture("Stand")


def facts(robot):
    """Return what tells a robot's limits and masses; runs in another process too."""
    torque = pk.dynamics.gravity_torque(robot, Q[-robot.n :] if robot.n <= 15 else robot.neutral())
    return (
        robot.upper_limits, robot.velocity_limits, robot.effort_limits, torque, pk.dynamics.total_mass(robot),
        pk.model.robot_digest(robot),
    )  # fmt: skip


def changed():
    limits = {"upper": {"HeadYaw": 0.5}, "velocity": 1.5, "effort": {"LElbowRoll": 0.9}}
    return PEPPER.with_limits(**limits).with_masses({"LForeArm": 1.3})


def by_hand():
    robot = pk.load_robot(PEPPER.urdf)
    heavy = pinocchio.Inertia(2.0, np.zeros(3), 0.01 * np.eye(3))
    model = robot.pinocchio_model
    model.inertias[4] = model.inertias[4] + heavy
    return robot.with_pinocchio_model(model)


OTHER_PROCESS = """
import pickle, runpy, sys
facts = runpy.run_path(sys.argv[1])["facts"]
sys.stdout.buffer.write(pickle.dumps(facts(pickle.load(sys.stdin.buffer))))
"""


@pytest.mark.parametrize("make", [changed, by_hand])
@pytest.mark.parametrize(
    "pass_on", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))]
)
def test_copies_are_the_same_robot(make, pass_on):
    robot = make()
    again = pass_on(robot)
    for mine, its in zip(facts(robot), facts(again), strict=True):
        np.testing.assert_array_equal(mine, its)
    assert facts(again)[-1] != facts(PEPPER)[-1]
    assert np.abs(facts(again)[3] - facts(PEPPER)[3]).max() > 1e-3


@pytest.mark.parametrize("make", [changed, by_hand])
def test_other_processes_get_the_same_robot(make):
    robot = make()
    done = subprocess.run(
        [sys.executable, "-c", OTHER_PROCESS, __file__],
        input=pickle.dumps(robot),
        stdout=subprocess.PIPE,
        timeout=200,
        check=True,
    )
    its = pickle.loads(done.stdout)
    for mine, other in zip(facts(robot), its, strict=True):
        np.testing.assert_array_equal(mine, other)


def test_the_search_for_a_place_keeps_the_limits():
    """Hands reach a point behind a limit of the elbow only from elsewhere, and the answers keep the limit."""
    narrow = PEPPER.with_limits(lower={"LElbowRoll": -0.6}).with_masses({"LForeArm": 0.5})
    elbow = narrow.joint_index("LElbowRoll")
    result = pk.base_placement.place_base(narrow, [pk.ik.HandPosition("left", (1.2, 0.4, 0.8))])
    assert result.success
    for place in result.placements:
        assert (place.q[:, elbow] >= -0.6 - 1e-9).all()
