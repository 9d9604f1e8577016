"""The scene that a twin gets is its world: what it runs into, and what the run says of it."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.twin.run_status import END_TOLERANCE, RunStatus

WALL = pk.Scene().add_box("wall", size=(0.05, 2.0, 2.0), position=(0.4, 0.0, 1.0))
FLOOR = pk.Scene().add_half_space("floor", (0.0, 0.0, 1.0))


@pytest.fixture(scope="module")
def reach(pepper):
    """A motion of the left hand to 0.45 m in front of the robot, planned without knowing of the wall."""
    plan = pk.plan(pepper, pepper.posture("Stand"), [pk.ik.HandPosition("left", (0.45, 0.2, 0.9))], seed=0)
    return pk.retime(pepper, plan)


def test_wall_blocks_twin(pepper, reach):
    """The hand stays on its side of the wall, and the run says what blocks it and how far it is."""
    run = pk.Twin(pepper, scene=WALL).execute(reach)
    assert run.status is RunStatus.BLOCKED
    assert not run.success
    error = np.abs(run.tracking_error[-1])
    joint = pepper.joint_names[int(np.argmax(error))]
    assert error.max() > END_TOLERANCE["rad"]
    assert run.message.startswith(f"{joint} ends {error.max():.3g} rad from its reference: ")
    assert "wall" in run.message
    assert run.report().splitlines()[-1] == RunStatus.BLOCKED.advice
    depth = pk.collision.clearance(pepper, run.position[::20], WALL, to="obstacles")
    assert depth.min() > -2e-3
    assert pk.collision.clearance(pepper, reach.sample(0.02).position, WALL, to="obstacles").min() < -0.02
    assert pk.Twin(pepper).execute(reach).status is RunStatus.COMPLETED


def test_without_contact_nothing_changes(pepper, reach):
    """A scene that is not touched changes no bit of the run."""
    far = pk.Scene().add_box("far", size=(0.1, 0.1, 0.1), position=(3.0, 0.0, 1.0))
    alone, inside = pk.Twin(pepper).execute(reach), pk.Twin(pepper, scene=far).execute(reach)
    assert inside.status is RunStatus.COMPLETED
    np.testing.assert_array_equal(inside.position, alone.position)
    np.testing.assert_array_equal(inside.torque, alone.torque)


def test_touched_on_the_way(pepper):
    """A run that comes to its end after it was touched says so."""
    q = pepper.joint_vector({"LShoulderPitch": 0.3, "LShoulderRoll": 0.2, "LElbowRoll": -0.3})
    hand = pk.kinematics.frame_pose(pepper, q, "l_gripper")[:3, 3]
    ball = pk.Scene().add_sphere("ball", 0.05, hand + np.array([0.1, 0.6, 0.0]), velocity=(0.0, -0.5, 0.0))
    still = pk.Trajectory.from_positions(times=[0.0, 3.0], positions=[q, q], pepper=pepper)
    twin = pk.Twin(pepper, scene=ball)
    run = twin.execute(still)
    assert run.status is RunStatus.TOUCHED
    assert "ball" in run.message
    force = np.linalg.norm(run.external_wrench[:, :3], axis=1)
    assert force.max() > 1.0
    again = twin.execute(still)  # the ball starts where it is at time 0
    np.testing.assert_array_equal(again.position, run.position)


def test_late_and_off_reference(pepper, reach):
    """A robot that is still on its way is late; one that cannot hold its posture stands off its reference."""
    slow = pk.twin.actuator_parameters(pepper).changed(latency=0.4)
    run = pk.Twin(pepper, actuators=slow).execute(reach)
    assert run.status is RunStatus.LATE
    assert pk.Twin(pepper, actuators=slow).execute(reach, hold_time=1.0).status is RunStatus.COMPLETED
    run = pk.Twin(pepper, payload={"left": 8.0}).execute(reach, hold_time=2.0)
    assert run.status is RunStatus.OFF_REFERENCE
    assert "from its reference" in run.message


def test_status_survives_files(pepper, reach, tmp_path):
    """A saved run is as far from its reference as it was; a recording keeps the status itself."""
    run = pk.Twin(pepper, scene=WALL).execute(reach)
    assert not pk.twin.load_run(pepper, run.save(tmp_path / "run.csv")).success
    recorder = pk.twin.Recorder(pk.Twin(pepper, scene=WALL), tmp_path / "recording", chunk=0.2)
    twin = recorder.twin
    twin.reset(reach(0.0).position)
    recorded = recorder.execute(reach)
    assert recorded.status is RunStatus.BLOCKED
    whole = recorder.recording.run()
    assert (whole.status, whole.message) == (recorded.status, recorded.message)
    assert whole.duration == pytest.approx(reach.duration, abs=2e-3)


@pytest.mark.parametrize(
    "floor", [FLOOR, pk.Scene().add_box("floor", size=(4.0, 4.0, 0.1), position=(0.0, 0.0, -0.05))]
)
def test_wheels_roll_on_the_floor(floor):
    """The floor neither lifts nor brakes a robot on a planar base, and a post on it stops it."""
    mobile = pk.load_pepper(base="planar")
    q = mobile.posture("Stand")
    goal = q.copy()
    goal[mobile.joint_names.index("BaseX")] += 0.5
    drive = pk.retime(mobile, pk.plan(mobile, q, goal))
    run = pk.Twin(mobile, scene=floor).execute(drive)
    assert run.status is RunStatus.COMPLETED
    assert not run.external_wrench.any()
    post = floor.add_box("post", size=(0.1, 0.1, 0.8), position=(0.5, 0.0, 0.4))
    run = pk.Twin(mobile, scene=post).execute(drive)
    assert run.status is RunStatus.BLOCKED
    assert "BaseX" in run.message
    assert "post" in run.message
    assert run.position[-1][0] < 0.3
