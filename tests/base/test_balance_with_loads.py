"""What a robot carries is part of verdicts on its balance: against Pinocchio with it as part of a link."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision import loads_of
from pepper_kin.dynamics.load import Load
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin import Recorder, Twin, actuator_parameters, load_run
from pepper_kin.twin.base import BalanceMonitor, TippingStatus, edge_moments, simulate_tipping
from pepper_kin.twin.world import World

PEPPER = pk.load_pepper()
MONITOR = BalanceMonitor(PEPPER)
SIZE = (0.12, 0.04, 0.3)
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.1, 0.004, 0.02]))
CUP = pk.Scene().add_box("cup", SIZE, (2.0, 2.0, 0.5))
ARM_OUT = PEPPER.joint_vector({"LShoulderPitch": 0.1, "LShoulderRoll": 1.3, "LElbowRoll": -0.02})


def held(mass, frame="l_gripper"):
    return CUP.attach("cup", frame, POSE.homogeneous, mass=mass)


def loaded(mass, frame="l_gripper", pepper=PEPPER):
    """Return a robot with the object as part of a link."""
    model = pepper.pinocchio_model
    place = model.frames[pepper.frame_id(frame)]
    model.appendBodyToJoint(place.parentJoint, pinocchio.Inertia.FromBox(mass, *SIZE), place.placement * POSE)
    return pepper.with_pinocchio_model(model)


def stiff():
    """Return actuators that hold any object, so that the robot is a rigid body."""
    actuators = actuator_parameters(PEPPER)
    hard = {"stiffness": 1e4 * actuators.stiffness, "damping": 1e3 * actuators.damping}
    return actuators.changed(**hard, torque_limit=np.full(PEPPER.n, 1e6))


def tipping_mass(q):
    """Return the mass at which the center of all lies over an edge of the wheels: moments of weight."""
    data = PEPPER.inner_model.createData()
    moving = pinocchio.centerOfMass(PEPPER.inner_model, data, q)
    still, frame = PEPPER.inner_model.inertias[0], PEPPER.frame_id("l_gripper")
    robot = data.mass[0] + still.mass
    center = (data.mass[0] * moving + still.mass * still.lever)[:2] / robot
    pinocchio.framesForwardKinematics(PEPPER.inner_model, data, q)
    place = (data.oMf[frame] * POSE).translation[:2]
    least = np.inf
    corners = MONITOR.contacts
    for one, two in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (two - one) / np.linalg.norm(two - one)
        outward = np.array([along[1], -along[0]])
        if outward @ (place - one) > 0:
            least = min(least, robot * (outward @ (one - center)) / (outward @ (place - one)))
    return least


def motion(pepper, count=60):
    rng, time = np.random.default_rng(3), np.linspace(0.0, 0.5, count)
    size, w = 0.1 * rng.normal(size=pepper.n), 6.0 * rng.uniform(0.5, 1.0, pepper.n)
    middle = (np.maximum(pepper.lower_limits, -0.5) + np.minimum(pepper.upper_limits, 1.1)) / 2
    q = middle + size * np.sin(np.outer(time, w))
    return time, q, size * w * np.cos(np.outer(time, w)), -size * w**2 * np.sin(np.outer(time, w))


@pytest.mark.thorough
@pytest.mark.parametrize("frame", ["l_gripper", "Head", "base_link"])
@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_balance_and_moments_are_those_of_a_robot_with_the_object_as_part_of_a_link(frame, base):
    pepper = pk.load_pepper(base=base)
    time, q, v, a = motion(pepper)
    own, other = BalanceMonitor(pepper), BalanceMonitor(loaded(2.0, frame, pepper))
    found = own.assess(time, q, v, a, loads=loads_of(pepper, held(2.0, frame)))
    expected = other.assess(time, q, v, a)
    for name in ("wrench", "point", "distances", "friction", "wheel_forces"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-8, err_msg=name)
    assert np.abs(found.margin - own.assess(time, q, v, a).margin).max() > 0.002
    for edge in range(3):
        ours, its = edge_moments(own, found, q, edge), edge_moments(other, expected, q, edge)
        for name in ("inertia", "inside", "height", "drive", "weight"):
            np.testing.assert_allclose(getattr(ours, name), getattr(its, name), atol=1e-8, err_msg=name)


def test_an_object_held_out_tips_the_robot_from_the_mass_of_statics_on():
    mass = tipping_mass(ARM_OUT)
    assert 1.0 < mass < 50.0
    rows, verdicts = np.tile(ARM_OUT, (400, 1)), []
    for share in (0.97, 1.03):
        twin = Twin(PEPPER, actuators=stiff(), world=World(PEPPER, held(share * mass)))
        twin.reset(ARM_OUT)
        run = twin.follow(rows)
        assert not run.external_wrench.any()
        verdicts.append(MONITOR.assess_run(run))
    assert verdicts[0].balanced
    assert verdicts[0].margin[-1] < 0.01
    assert not verdicts[1].balanced
    assert "of 'cup' at l_gripper" in verdicts[1].report()
    twin = Twin(PEPPER, actuators=stiff(), payload={"l_gripper": 1.2 * mass})
    twin.reset(ARM_OUT)
    assert not MONITOR.assess_run(twin.follow(rows)).balanced
    twin = Twin(PEPPER, actuators=stiff())
    twin.reset(ARM_OUT)
    run = twin.follow(rows)
    assert run.loads == ()
    assert MONITOR.assess_run(run).margin.min() > 0.03


def test_a_robot_falls_towards_what_it_holds():
    mass = 1.1 * tipping_mass(ARM_OUT)
    twin = Twin(PEPPER, 0.005, actuators=stiff(), world=World(PEPPER, held(mass)))
    twin.reset(ARM_OUT)
    run = twin.follow(np.tile(ARM_OUT, (900, 1)))
    report = MONITOR.assess_run(run)
    tipped = simulate_tipping(MONITOR, report, run.position)
    assert tipped.status is TippingStatus.FALLEN
    assert "WheelFL" in tipped.message  # on the side of the arm
    alone = MONITOR.assess(run.time, run.position, run.velocity, 0 * run.velocity)
    assert simulate_tipping(MONITOR, alone, run.position).status is TippingStatus.STOOD


def test_verdicts_on_recordings_and_files_count_what_was_carried(tmp_path):
    twin = Twin(PEPPER, 0.002, actuators=stiff(), world=World(PEPPER, held(0.8 * tipping_mass(ARM_OUT))))
    twin.reset(ARM_OUT)
    recorder = Recorder(twin, tmp_path / "r")
    run = recorder.follow(np.tile(ARM_OUT, (100, 1)))
    margin = MONITOR.assess_run(run).margin
    np.testing.assert_array_equal(MONITOR.assess_run(recorder.recording.run()).margin, margin)
    path = run.save(tmp_path / "run.csv")
    np.testing.assert_array_equal(MONITOR.assess_run(load_run(PEPPER, path, run.loads)).margin, margin)
    assert (MONITOR.assess_run(load_run(PEPPER, path)).margin > margin + 0.03).all()


def test_what_are_no_loads_is_refused(tmp_path):
    for wrong in [3.0, "cup", [1.0], {"left": 1.0}, np.ones(3)]:
        time, q, v, a = motion(PEPPER, 3)
        with pytest.raises(InvalidValueError, match=r"loads: got .*collision\.loads_of"):
            MONITOR.assess(time, q, v, a, loads=wrong)
        path = Twin(PEPPER).follow(q).save(tmp_path / "run.csv")
        with pytest.raises(InvalidValueError, match="loads: got"):
            load_run(PEPPER, path, wrong)
        with pytest.raises(UnknownNameError, match="tail"):
            MONITOR.assess(time, q, v, a, loads=(Load("tail", 1.0),))
