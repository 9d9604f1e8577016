"""Forces from outside in a run of the twin: recorded, saved, and part of every verdict on balance."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin import Recorder, Run, Twin, actuator_parameters, load_run
from pepper_kin.twin.base import BalanceMonitor, TippingStatus, simulate_tipping
from pepper_kin.twin.world import World

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
MONITOR = BalanceMonitor(PEPPER)
G = 9.81


def stiff():
    """Return actuators that a push hardly moves, so that the robot is a rigid body."""
    actuators = actuator_parameters(PEPPER)
    hard = {"stiffness": 1e4 * actuators.stiffness, "damping": 1e3 * actuators.damping}
    return actuators.changed(**hard, torque_limit=np.full(PEPPER.n, 1e6))


def tipping_force(frame, direction):
    """Return the horizontal force that tips a rigid robot: moment about an edge of force and of weight."""
    center, height = pk.dynamics.center_of_mass(PEPPER, STAND), height_of(frame)
    least = np.inf
    corners = MONITOR.contacts
    for one, two in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (two - one) / np.linalg.norm(two - one)
        outward = np.array([along[1], -along[0]])
        push = outward @ direction[:2]
        if push > 0:
            inside = (one - center[:2]) @ outward
            least = min(least, pk.dynamics.total_mass(PEPPER) * G * inside / (height * push))
    return least


def height_of(frame):
    return pk.kinematics.frame_pose(PEPPER, STAND, frame)[2, 3]


def test_a_push_tips_from_the_analytic_force_on():
    for frame, direction in [
        ("torso", (1, 0)),
        ("torso", (0, 1)),
        ("Head", (-1, 0.3)),
        ("l_wrist", (0.2, -1)),
    ]:
        way = np.array([*direction, 0.0]) / np.linalg.norm(direction)
        force = tipping_force(frame, way)
        if (frame, direction) == ("torso", (1, 0)):
            assert force == pytest.approx(38.6, abs=0.1)
        verdicts = []
        for share in (0.97, 1.03):
            twin = Twin(PEPPER, actuators=stiff())
            twin.push(frame, share * force * way, start=0.0, duration=np.inf)
            run = twin.follow(np.tile(STAND, (100, 1)))
            np.testing.assert_allclose(run.external_wrench[1:, :3], np.tile(share * force * way, (100, 1)))
            verdicts.append(MONITOR.assess_run(run))
        assert verdicts[0].balanced
        assert verdicts[0].margin.min() < 0.01
        assert not verdicts[1].balanced
        assert "outside the line" in verdicts[1].report()


def test_twice_the_tipping_force_fells_the_robot():
    twin = Twin(PEPPER, actuators=stiff())
    twin.push("torso", [80.0, 0.0, 0.0], start=0.1, duration=1.5)
    run = twin.follow(np.tile(STAND, (1600, 1)))
    report = MONITOR.assess_run(run)
    assert report.event.time == pytest.approx(0.1, abs=0.002)
    assert simulate_tipping(MONITOR, report, run.position).status is TippingStatus.FALLEN
    assert "kept throughout" not in report.report()
    assert "base held" in run.report()
    assert "outside force: at most 80 N" in run.report()
    assert run.as_dict()["base_held"]
    assert run.as_dict()["external_force"] == pytest.approx(80.0)


@pytest.mark.parametrize(("name", "start"), [("Head", (0.0, 0.0, 1.35)), ("base", (0.16, 0.0, 0.6))])
@pytest.mark.parametrize("substeps", [1, 3])
def test_contacts_of_the_robot_are_the_loss_of_momentum_of_what_falls_on_it(name, start, substeps):
    """Newton's third law: a falling ball tells what acted on the robot, its fixed base included."""
    world, h, mass = World(PEPPER), 0.002, 0.7
    world.add_ball("ball", 0.05, mass, start, velocity=(0.1, 0, -1.0, 0, 3.0, 0))
    twin = Twin(PEPPER, h, world=world, substeps=substeps)
    before = world.bodies["ball"].momentum
    run = twin.follow(np.tile(STAND, (150, 1)))
    assert np.abs(run.external_wrench).max() > 1.0, name
    weight = np.array([0.0, 0.0, -mass * G])
    lost = before + 0.3 * np.concatenate([weight, np.zeros(3)]) - world.bodies["ball"].momentum
    np.testing.assert_allclose(h * run.external_wrench[:, :3].sum(axis=0), lost[:3], atol=1e-9)
    # Angular momentum about the origin: points are taken at the start of a step, which is of order h.
    path = np.zeros(3)
    again = World(PEPPER)
    again.add_ball("ball", 0.05, mass, start, velocity=(0.1, 0, -1.0, 0, 3.0, 0))
    other = Twin(PEPPER, h, world=again, substeps=substeps)
    for row in np.tile(STAND, (150, 1)):
        path += h * again.bodies["ball"].position
        other.step(row)
    lost[3:] += np.cross(path, weight)
    np.testing.assert_allclose(h * run.external_wrench[:, 3:].sum(axis=0), lost[3:], atol=0.02)


def test_a_world_without_forces_on_the_robot_gives_none():
    world = World(PEPPER, pk.Scene().add_half_space("ground", (0, 0, 1), -1.0))
    world.add_box("far", (0.1, 0.1, 0.1), 1.0, (2, 0, -0.95))
    run = Twin(PEPPER, world=world).follow(np.tile(STAND, (60, 1)))
    assert not run.external_wrench.any()
    assert "outside force" not in run.report()


def test_a_push_of_half_a_step_counts_half():
    twin = Twin(PEPPER, 0.004, substeps=4)
    twin.push("torso", [8.0, 0.0, 0.0], start=0.002, duration=0.002)
    run = twin.follow(np.tile(STAND, (3, 1)))
    np.testing.assert_allclose(run.external_wrench[:, 0], [0.0, 4.0, 0.0, 0.0])


def test_outside_forces_survive_files_and_recordings(tmp_path):
    twin = Twin(PEPPER, 0.002)
    twin.push("torso", [30.0, 5.0, 0.0], [0.0, 0.0, 0.1], start=0.05, duration=0.2)
    recorder = Recorder(twin, tmp_path / "r", chunk=0.1)
    run = recorder.follow(np.tile(STAND, (150, 1)))
    assert np.count_nonzero(run.external_wrench[:, 0]) == 100
    recording = recorder.recording
    saved = [load_run(PEPPER, run.save(tmp_path / "run.csv")), recording.run()]
    saved.append(load_run(PEPPER, recording.save(tmp_path / "recording.csv")))
    for again in saved:
        np.testing.assert_array_equal(again.external_wrench, run.external_wrench)
        np.testing.assert_array_equal(
            MONITOR.assess_run(again).margin, MONITOR.assess_run(run).margin, strict=True
        )
    with np.load(recording.save(tmp_path / "r.npz")) as data:
        np.testing.assert_array_equal(data["external_wrench"], run.external_wrench)
    from mcap_ros2.reader import read_ros2_messages

    sent = list(read_ros2_messages(recording.save(tmp_path / "r.mcap"), topics=["/external_wrench"]))
    np.testing.assert_array_equal([m.ros_msg.data for m in sent], run.external_wrench[26:126])


def test_loads_of_unknown_origin_need_their_forces_for_a_verdict(tmp_path):
    twin = Twin(PEPPER)
    load = np.zeros((20, PEPPER.n))
    load[5:8, 3] = 0.1
    run = twin.follow(np.tile(STAND, (20, 1)), load=load)
    assert np.flatnonzero(np.isnan(run.external_wrench).all(axis=1)).tolist() == [6, 7, 8]
    with pytest.raises(InvalidValueError, match=r"loads on joints in 3 steps.*`external`"):
        MONITOR.assess_run(run)
    assert MONITOR.assess_run(run, np.zeros(6)).balanced
    assert "unknown outside forces in 3 steps, from 0.006 s" in run.report()
    assert run.as_dict()["external_force"] is None
    again = load_run(PEPPER, run.save(tmp_path / "run.csv"))
    np.testing.assert_array_equal(again.external_wrench, run.external_wrench)

    class Wind:
        def advance(self, q, v, mass_hat, force, h):
            return np.full(PEPPER.n, 0.01)

    blown = Twin(PEPPER, world=Wind()).follow(np.tile(STAND, (4, 1)))
    assert np.isnan(blown.external_wrench[1:]).all()
    with pytest.raises(InvalidValueError, match="external_wrench: got shape"):
        Run(**{**vars(run), "external_wrench": np.zeros((3, 6))})
