"""Robots without an SRDF: neighbors may overlap, all else is as Pinocchio and coal say."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk

SHARE = Path(importlib.metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share"))
ROBOTS = SHARE / "example-robot-data" / "robots"

BAR = '<{0}><origin xyz="0.2 0 0"/><geometry><box size="0.5 0.06 0.06"/></geometry></{0}>'
JOINT = """<joint name="j{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="2"/></joint>"""
BARS = (
    '<robot name="bars">'
    + f'<link name="base">{BAR.format("collision")}</link><link name="plate">{BAR.format("collision")}</link>'
    + '<joint name="weld" type="fixed"><parent link="base"/><child link="plate"/></joint>'
    + f'<link name="cross"/><link name="arm">{BAR.format("collision")}</link>'
    + f'<link name="hand">{BAR.format("collision")}</link>'
    + JOINT.format(0, "base", "cross", 0.4)
    + JOINT.format(1, "cross", "arm", 0)
    + JOINT.format(2, "arm", "hand", 0.4)
    + "</robot>"
)


def test_neighbors_are_one_joint_apart_and_empty_links_are_not_counted():
    robot = pk.load_robot(BARS)
    assert set(robot.semantics.disabled_pairs) == {("arm", "base"), ("arm", "plate"), ("arm", "hand")}
    assert not pk.collision.in_collision(robot, robot.neutral())
    folded = pk.collision.contacts(robot, [0.0, 0.0, 3.0])
    assert {frozenset(contact.names) for contact in folded} == {
        frozenset(("base", "hand")),
        frozenset(("plate", "hand")),
    }


def test_pairs_that_an_srdf_disables_are_the_only_ones_left_out():
    srdf = '<robot name="bars"><disable_collisions link1="arm" link2="hand" reason="Adjacent"/></robot>'
    robot = pk.load_robot(BARS, srdf)
    touching = {frozenset(c.names) for c in pk.collision.contacts(robot, robot.neutral())}
    assert touching == {frozenset(("base", "arm")), frozenset(("plate", "arm"))}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "place", ["double_pendulum_description/urdf/double_pendulum", "z1_description/urdf/z1"]
)
def test_verdicts_are_those_of_pinocchio_without_neighbors(place):
    path = ROBOTS / f"{place}.urdf"
    robot = pk.load_robot(path, package_dirs=[SHARE, ROBOTS])
    model, solids, _ = pinocchio.buildModelsFromUrdf(str(path), [str(SHARE), str(ROBOTS)], None)
    parents, objects = list(model.parents), solids.geometryObjects
    for i, a in enumerate(objects):
        for j in range(i + 1, len(objects)):
            low, high = sorted((a.parentJoint, objects[j].parentJoint))
            if low != high and parents[high] != low:
                solids.addCollisionPair(pinocchio.CollisionPair(i, j))
    data, solids_data = model.createData(), solids.createData()
    rng = np.random.default_rng(3)
    lower, upper = np.maximum(robot.lower_limits, -3), np.minimum(robot.upper_limits, 3)
    verdicts = []
    for q in rng.uniform(lower, upper, (40, robot.n)):
        theirs = pinocchio.computeCollisions(model, data, solids, solids_data, q, True)
        assert pk.collision.in_collision(robot, q) == theirs
        verdicts.append(theirs)
    assert not all(verdicts)


def test_a_robot_without_srdf_can_be_planned_for():
    robot = pk.load_robot(BARS)
    plan = pk.plan(robot, robot.neutral(), [0.5, 0.4, -0.6], seed=0)
    assert plan.status is pk.motion.PlanStatus.SOLVED, plan.report()
