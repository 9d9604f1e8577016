"""The twin: following trajectories, single steps, refusals, runs and their files."""

import json

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, LimitError
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import DivergedError, Run, Twin, actuator_parameters, load_run


@pytest.fixture(scope="module")
def trajectory(pepper):
    goal = pepper.joint_vector({"LShoulderPitch": 0.4, "LElbowRoll": -0.9, "HeadYaw": 0.6, "HipPitch": -0.2})
    return pk.retime(pepper, [pepper.posture("Stand"), goal])


@pytest.fixture(scope="module")
def run(pepper, trajectory):
    return Twin(pepper).execute(trajectory, hold_time=0.3)


def test_default_twin_tracks_well(run, trajectory):
    assert run.success
    assert run.status.value == "completed"
    assert run.max_error.max() < 0.005
    assert run.rms_error.max() < 0.002
    assert np.abs(run.tracking_error[-1]).max() < 1e-4
    assert run.time[0] == 0.0
    np.testing.assert_allclose(np.diff(run.time), 0.001, atol=1e-12)
    assert trajectory.duration + 0.3 <= run.duration <= trajectory.duration + 0.3011


def test_feedforward_orders_the_errors(pepper, trajectory, run):
    errors = {"gravity": run.rms_error}
    for kind in ("none", "inverse_dynamics"):
        errors[kind] = Twin(pepper, feedforward=kind).execute(trajectory).rms_error
    assert np.linalg.norm(errors["inverse_dynamics"]) < 0.5 * np.linalg.norm(errors["gravity"])
    assert np.linalg.norm(errors["gravity"]) < np.linalg.norm(errors["none"])


def test_without_feedforward_gravity_bends_the_servos(pepper):
    q = pepper.posture("Stand")
    twin = Twin(pepper, feedforward="none")
    for _ in range(1500):
        state = twin.step(q)
    expected = -pk.dynamics.gravity_torque(pepper, state.position) / actuator_parameters(pepper).stiffness
    np.testing.assert_allclose(state.position - q, expected, atol=1e-6)


def test_run_obeys_torque_limits_and_newton(pepper, run):
    assert np.all(np.abs(run.torque) <= pepper.effort_limits)
    assert np.all(run.torque_use <= 1)
    a = np.diff(run.velocity, axis=0) / 0.001
    expected = pk.dynamics.newton_euler(pepper, run.position[:-1], run.velocity[:-1], a)
    np.testing.assert_allclose(run.torque[1:], expected, rtol=1e-6, atol=1e-6)


def test_smaller_steps_converge(pepper, trajectory):
    ends = []
    for h in (2e-3, 1e-3, 5e-4):
        twin = Twin(pepper, h, feedforward="none")
        ends.append(twin.execute(trajectory).position_at(0.2))
    ratio = np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2])
    assert 1.5 < ratio < 3.0


def test_execute_equals_its_own_steps(pepper, trajectory, run):
    twin = Twin(pepper)
    twin.reset(trajectory.start)
    for k in range(1, 50):
        state = twin.step(run.reference_position[k], run.reference_velocity[k])
        np.testing.assert_array_equal(state.position, run.position[k])
        np.testing.assert_array_equal(state.torque, run.torque[k])
    assert state.time == pytest.approx(0.049)


def test_execution_starts_at_the_trajectory_or_where_the_twin_is(pepper, trajectory):
    twin = Twin(pepper)
    first = twin.execute(trajectory)
    np.testing.assert_array_equal(first.position[0], trajectory.start)
    np.testing.assert_array_equal(twin.state.position, first.position[-1])
    again = twin.execute(trajectory, from_present=True)
    np.testing.assert_array_equal(again.position[0], first.position[-1])
    fresh = twin.execute(trajectory)
    np.testing.assert_array_equal(fresh.position, first.position)


def test_load_from_outside_is_felt(pepper):
    twin = Twin(pepper)
    q = pepper.posture("Stand")
    push = 1.0 * (np.arange(15) == pepper.joint_index("HeadYaw"))
    for _ in range(1000):
        state = twin.step(q, load=push)
    assert state.position[3] - q[3] == pytest.approx(1.0 / 1000, rel=1e-3)
    held = pk.dynamics.gravity_torque(pepper, state.position)[3]
    assert state.torque[3] == pytest.approx(held - 1.0, rel=1e-3)


def test_state_is_a_snapshot(pepper):
    twin = Twin(pepper)
    before = twin.state
    twin.step(pepper.posture("Stand") + 0.01)
    assert np.array_equal(before.position, pepper.posture("Stand"))
    with pytest.raises(ValueError, match="read-only"):
        before.position[0] = 1.0


def test_bad_values_are_refused(pepper, trajectory):
    twin = Twin(pepper)
    q = pepper.posture("Stand")
    for call, message in [
        (lambda: twin.step(q * np.nan), "position: got nan at joint KneePitch"),
        (lambda: twin.step(q, q[:3]), r"velocity: got shape \(3,\)"),
        (lambda: twin.step(q, load=np.full(15, np.inf)), "load: got"),
        (lambda: twin.step(np.tile(q, (2, 1))), r"position: got shape \(2, 15\), expected shape \(15,\)"),
        (lambda: twin.reset(q * np.nan), "q: got nan"),
        (lambda: twin.execute(trajectory, hold_time=-1), "hold_time: got -1"),
        (lambda: twin.execute(trajectory, hold_time=np.nan), "hold_time: got nan"),
        (lambda: Twin(pepper, feedforward="magic"), "feedforward: got 'magic', expected one of 'none'"),
        (lambda: Twin(pepper, -0.001), "timestep: got -0.001"),
        (lambda: Twin(pepper, 0.0), "timestep: got 0.0"),
        (lambda: Twin(pepper, np.nan), "timestep: got nan"),
        (lambda: Twin(pepper, 0.1), r"timestep: got 0.1 s, expected a number in \(0, 0.05\] s"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            call()
    with pytest.raises(LimitError, match="q: HeadYaw = 9 rad"):
        twin.reset(np.where(np.arange(15) == 3, 9.0, q))
    np.testing.assert_array_equal(twin.state.position, q)
    other = Trajectory(("A",), [0.0, 1.0], np.zeros((1, 1, 1)))
    with pytest.raises(InvalidValueError, match="joints of the trajectory: got A, expected KneePitch"):
        twin.execute(other)


WEIGHTLESS = """
<robot name="w"><link name="world"/><link name="a"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><mass value="0"/>
  <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="Good" type="continuous"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="Bad" type="continuous"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/></joint>
</robot>"""


def test_divergence_stops_the_run_and_keeps_the_log():
    robot = pk.load_robot(WEIGHTLESS)
    limp = actuator_parameters(robot).changed(stiffness=[10.0, 0.0], damping=[5.0, 0.0])
    twin = Twin(robot, actuators=limp, feedforward="none")
    with pytest.raises(DivergedError, match=r"twin stopped at step 1 .*: .*velocity became nan") as caught:
        twin.step(np.zeros(2))
    assert caught.value.step == 1
    assert caught.value.joint in robot.joint_names
    still = Trajectory(robot.joint_names, [0.0, 1.0], np.zeros((1, 1, 2)))
    run = twin.execute(still)
    assert run.status.value == "stopped"
    assert not run.success
    assert "step 1 (0.001 s)" in run.message
    assert len(run) == 1
    assert np.isfinite(run.position).all()
    assert "stopped (twin stopped at step 1" in run.report()


def test_runaway_is_named_with_what_came_before(pepper):
    far = 1e6 * (np.arange(15) == 4)
    twin = Twin(pepper)
    q = pepper.posture("Stand")
    twin.step(q)
    with pytest.raises(DivergedError, match=r"step 2 \(0.002 s\): HeadPitch: velocity became") as caught:
        twin.step(q, load=far * 1e3)
    assert caught.value.time == pytest.approx(0.002)
    assert twin.state.time == pytest.approx(0.001)


def test_report_and_dictionary(run):
    text = run.report()
    assert text.startswith("Run of ")
    assert "steps: completed" in text
    worst = run.joint_names[int(np.argmax(run.max_error))]
    assert f"worst tracking: {worst}, at most {run.max_error.max():.3g} rad" in text
    assert len(text.splitlines()) == 4 + 15
    data = json.loads(json.dumps(run.as_dict()))
    assert data["steps"] == len(run) - 1
    assert data["joints"]["KneePitch"]["torque_use"] == pytest.approx(run.torque_use[0])


def test_statistics_are_what_they_say(pepper):
    zeros = np.zeros((2, 1))
    run = Run(("J",), ("rad",), [0, 1], [[0], [3]], zeros, [[-4], [2]], [[0], [-1]], zeros, [8.0])
    np.testing.assert_array_equal(run.tracking_error, [[0], [4]])
    assert run.rms_error == pytest.approx(np.sqrt(8))
    assert run.max_error == 4
    assert run.peak_torque == 4
    assert run.torque_use == 0.5
    np.testing.assert_allclose(run.position_at([0.0, 0.25, 1.0])[:, 0], [0, 0.75, 3])
    with pytest.raises(InvalidValueError, match=r"t: got 1.5, expected times within \[0, 1\] s"):
        run.position_at(1.5)
    with pytest.raises(InvalidValueError, match="torque: got shape"):
        Run(("J",), ("rad",), [0, 1], zeros, zeros, [[1]], zeros, zeros, [8.0])


def test_run_file_round_trip(pepper, run, tmp_path):
    path = run.save(tmp_path / "run.csv")
    header = path.read_text().split("\n", 1)[0].split(",")
    assert header[:2] == ["time", "KneePitch.position"]
    assert "KneePitch.torque" in header
    assert "KneePitch.reference" in header
    columns = json.loads((tmp_path / "columns.json").read_text())
    assert columns["KneePitch.torque"] == {"unit": "N m", "quantity": "torque", "joint": "KneePitch"}
    again = load_run(pepper, path)
    for name in ("time", "position", "velocity", "torque", "reference_position", "reference_velocity"):
        np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
    with pytest.raises(FileFormatError, match=r"is missing|unknown column"):
        load_run(pk.load_pepper(hands="mimic"), path)


def test_runs_repeat_exactly(pepper, trajectory, run):
    again = Twin(pepper).execute(trajectory, hold_time=0.3)
    np.testing.assert_array_equal(again.position, run.position)
    np.testing.assert_array_equal(again.torque, run.torque)


@pytest.mark.parametrize("h", [0.0005, 0.005, 0.02])
def test_other_timesteps_follow_too(pepper, trajectory, h):
    run = Twin(pepper, h).execute(trajectory, hold_time=0.5)
    assert run.success
    assert np.abs(run.tracking_error[-1]).max() < 1e-3


def test_threads_that_share_a_twin_take_turns(child):
    """In a process of its own, which ended by a segmentation fault."""
    program = """if True:
        import threading
        import pepper_kin as pk
        pepper = pk.load_pepper()
        still = pk.retime(pepper, [pepper.posture("Stand"), pepper.joint_vector({"HeadYaw": 0.5})])
        for _ in range(3):
            twin, ended = pk.Twin(pepper), []
            barrier = threading.Barrier(4)
            def execute():
                barrier.wait()
                for _ in range(3):
                    ended.append(twin.execute(still).success)
            threads = [threading.Thread(target=execute) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            print(len(ended))
    """
    assert child(program).stdout == "12\n" * 3
