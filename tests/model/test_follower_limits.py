"""Limits of joints that follow others bind their leader: an own reading of the URDF is the reference."""

import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, ModelError, ModelWarning

LINK = (
    '<link name="{}"><inertial><mass value="1"/>'
    '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)


def described(leaders, followers, rng, tight):
    """Return a URDF of a chain of joints, of which some follow others, also followers, in a random order."""
    names = [f"j{k}" for k in range(leaders + followers)]
    text = '<robot name="r"><link name="l0"/>' + "".join(LINK.format(f"l{k + 1}") for k in range(len(names)))
    for k, name in enumerate(rng.permutation(names)):
        i = names.index(name)
        mimic, kind = "", rng.choice(["revolute", "revolute", "prismatic", "continuous"])
        bound = rng.uniform(0.3, 3.0, 2)
        if i >= leaders:
            leader, gain = names[rng.integers(i)], rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.5)
            mimic = (
                f'<mimic joint="{leader}" multiplier="{gain:.17g}" offset="{rng.uniform(-0.2, 0.2):.17g}"/>'
            )
            bound *= tight
        velocity = "" if rng.random() < 0.2 and i >= leaders else f'velocity="{rng.uniform(0.5, 4.0):.17g}"'
        rest = f'acceleration="{rng.uniform(3.0, 20.0):.17g}"' if rng.random() < 0.7 or i < leaders else ""
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>'
            f'<axis xyz="0 0 1"/><limit lower="{-bound[0]:.17g}" upper="{bound[1]:.17g}" effort="900" '
            f"{velocity} {rest}/>{mimic}</joint>"
        )
    return text + "</robot>"


def excess(urdf, values, names, quantity):
    """Return by how much the worst joint leaves its own limits, followers by the chain of their elements.

    Args:
        urdf: The text.
        values: Of the leading joints.
        names: Their names.
        quantity: "position", "velocity" or "acceleration".
    """
    elements = {joint.get("name"): joint for joint in ET.fromstring(urdf).findall("joint")}
    known = dict(zip(names, values, strict=True))

    def value(name):
        if name not in known:
            mimic = elements[name].find("mimic")
            offset = float(mimic.get("offset", 0)) if quantity == "position" else 0.0
            known[name] = float(mimic.get("multiplier", 1)) * value(mimic.get("joint")) + offset
        return known[name]

    worst = -np.inf
    for name, joint in elements.items():
        limit, at = joint.find("limit"), value(name)
        if quantity == "position":
            if joint.get("type") != "continuous":
                worst = max(worst, at - float(limit.get("upper")), float(limit.get("lower")) - at)
        elif limit.get(quantity) is not None:
            worst = max(worst, abs(at) - float(limit.get(quantity)))
    return worst


def random_robots(count, seed, tight=1.0):
    """Yield URDFs and robots with followers; those whose limits exclude each other are left out."""
    rng = np.random.default_rng(seed)
    while count:
        urdf = described(int(rng.integers(1, 4)), int(rng.integers(1, 5)), rng, tight)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            try:
                robot = pk.load_robot(urdf)
            except ModelError as error:
                if "no position is within the limits of both" not in str(error):
                    raise
                continue
        count -= 1
        yield urdf, robot, rng


def test_limits_shown_are_those_that_no_joint_leaves():
    """Within them no joint is outside its own, and a little beyond any of them one is."""
    narrowed = 0
    for urdf, robot, rng in random_robots(150, 0):
        ends = {"position": (robot.lower_limits, robot.upper_limits)}
        for quantity in ("velocity", "acceleration"):
            most = getattr(robot, f"{quantity}_limits")
            ends[quantity] = (-most, most)
        for quantity, (low, high) in ends.items():
            low, high = np.where(np.isfinite(low), low, -9.0), np.where(np.isfinite(high), high, 9.0)
            for values in (low, high, *rng.uniform(low, high, (4, robot.n))):
                assert excess(urdf, values, robot.joint_names, quantity) < 1e-5
            for j in range(robot.n):
                for end, sign in ((low, -1.0), (high, 1.0)):
                    if abs(end[j]) < 9.0:
                        beyond = (low + high) / 2
                        beyond[j] = end[j] + sign * 1e-4
                        assert excess(urdf, beyond, robot.joint_names, quantity) > 1e-5
        own = {j.name: j for j in robot.document.joints}
        narrowed += any(
            own[name].upper != top for name, top in zip(robot.joint_names, robot.upper_limits, strict=True)
        )
    assert narrowed > 50


@pytest.mark.thorough
def test_motions_and_their_certificates_keep_the_limits_of_followers():
    certified = 0
    for urdf, robot, rng in random_robots(25, 1):
        low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -2.0)
        high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, 2.0)
        if (high - low < 0.05).any():
            continue
        motion = pk.retime(robot, rng.uniform(low, high, (3, robot.n)), torque=False)
        found = motion.check(robot, collisions=False)
        assert found.success, found.report()
        times = np.linspace(0.0, motion.duration, 200)
        for quantity, values in zip(("position", "velocity", "acceleration"), motion(times), strict=False):
            for row in values:
                assert excess(urdf, row, robot.joint_names, quantity) < 1e-5 * max(1.0, np.abs(row).max())
        faster = motion.scaled(0.9).check(robot, collisions=False)
        assert not faster.success
        certified += 1
    assert certified >= 15


@pytest.mark.thorough
def test_ik_twin_and_interpolation_see_them():
    for urdf, robot, _ in random_robots(12, 2, tight=0.5):
        q = pk.ik.solve(robot, [pk.ik.FramePosition(robot.link_names[-1], (5.0, 5.0, 0.0))]).q
        assert excess(urdf, q, robot.joint_names, "position") < 1e-5
        far = np.where(np.isfinite(robot.upper_limits), robot.upper_limits + 0.01, 0.0)
        if np.isfinite(robot.upper_limits).any():
            with pytest.raises(LimitError):
                pk.plan(robot, robot.neutral(), far)


def two_joints(leader, follower, mimic):
    """Return a URDF of a joint and one that follows it, with the attributes of their limits."""
    joints = [("lead", "l0", "l1", leader, ""), ("follow", "l1", "l2", follower, mimic)]
    return (
        '<robot name="r"><link name="l0"/>' + LINK.format("l1") + LINK.format("l2")
    ) + "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 0 1"/><limit effort="9" velocity="2" {limit}/>{more}</joint>'
        for name, parent, child, limit, more in joints
    ) + "</robot>"  # fmt: skip


def test_what_is_narrowed_is_said_and_what_excludes_itself_is_refused():
    urdf = two_joints(
        'lower="-1" upper="1"',
        'lower="-0.8" upper="0.8"',
        '<mimic joint="lead" multiplier="-2" offset="0.5"/>',
    )
    with pytest.warns(ModelWarning, match="joint lead: the limits of follow.*lower limit -1 -> -0.15"):
        robot = pk.load_robot(urdf, acceleration_limits=10.0)
    np.testing.assert_allclose(robot.lower_limits, [-0.15])
    np.testing.assert_allclose(robot.upper_limits, [0.65])
    np.testing.assert_allclose(robot.velocity_limits, [1.0])
    with pytest.raises(InvalidValueError, match=r"upper limit of lead.*0.65 or narrower: .*follow"):
        robot.with_limits(upper=0.9)
    assert robot.with_limits(upper=0.3).upper_limits[0] == 0.3
    apart = two_joints(
        'lower="0" upper="1"', 'lower="0.1" upper="1"', '<mimic joint="lead" multiplier="-1"/>'
    )
    with pytest.raises(ModelError, match=r"follow .*follows lead .*no position"):
        pk.load_robot(apart)
    stands = two_joints(
        'lower="0" upper="1"', 'lower="0.1" upper="1"', '<mimic joint="lead" multiplier="0"/>'
    )
    with pytest.raises(ModelError, match="factor 0 and stands at 0"):
        pk.load_robot(stands)


def test_effort_limits_of_followers_bind_nothing_as_in_pinocchio():
    """Pinocchio's mimic joints add no entry to the effort limits, nor to the torques that these bound."""
    urdf = two_joints(
        'lower="-1" upper="1"', 'lower="-2" upper="2"', '<mimic joint="lead" multiplier="-2"/>'
    ).replace('effort="9" velocity="2" lower="-2"', 'effort="0.01" velocity="4" lower="-2"')
    assert urdf.count('effort="0.01"') == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", ModelWarning)
        robot = pk.load_robot(urdf, acceleration_limits=10.0)
    model = pinocchio.buildModelFromXML(urdf, True)
    np.testing.assert_allclose(robot.effort_limits, model.effortLimit)
    q, v, a = np.array([0.3]), np.array([0.5]), np.array([4.0])
    torque = pinocchio.rnea(model, model.createData(), q, v, a)
    np.testing.assert_allclose(pk.dynamics.inverse_dynamics(robot, q, v, a), torque, atol=1e-12)
    motion = pk.retime(robot, [[-0.5], [0.5]])
    assert motion.check(robot, collisions=False).success
    with pytest.warns(ModelWarning, match="lead has no effort limit; those of follow, which follow it"):
        pk.load_robot(urdf.replace('effort="9"', ""), acceleration_limits=10.0)


def test_rounding_of_a_text_narrows_nothing():
    hands = pk.load_pepper(hands="mimic")
    joints = {joint.name: joint for joint in hands.document.joints}
    for name, low, high in zip(hands.joint_names, hands.lower_limits, hands.upper_limits, strict=True):
        assert (low, high) == (joints[name].lower, joints[name].upper)
