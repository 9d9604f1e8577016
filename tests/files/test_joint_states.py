"""Joint states of other programs as trajectories: written here by the modules csv and mcap_ros2."""

import csv
import io

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, OvershootWarning, UnknownNameError
from pepper_kin.files import read_joint_states
from pepper_kin.ros.mcap_file import STATE_TYPE
from pepper_kin.ros_messages import message_type
from pepper_kin.ros_messages.schemas import schema_text

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
TIMES = np.array([5.0, 5.1, 5.25, 5.4, 5.5])
YAW, PITCH = np.array([0.0, 0.02, 0.05, 0.08, 0.1]), np.array([-0.2, -0.2, -0.15, -0.1, -0.1])


def write_rows(path, header, *columns):
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(np.column_stack(columns).tolist())
    return path


def write_states(path, messages, topic="/joint_states"):
    """Write (stamp [s], names, positions) as JointState messages, as a recorder of ROS 2 does."""
    from mcap_ros2.writer import Writer

    content = io.BytesIO()
    writer = Writer(content)
    schema = writer.register_msgdef(STATE_TYPE, schema_text(message_type(STATE_TYPE)))
    for k, (stamp, names, positions) in enumerate(messages):
        sec, nanosec = divmod(round(stamp * 1e9), 10**9)
        header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
        message = {"header": header, "name": names, "position": positions, "velocity": [], "effort": []}
        writer.write_message(topic, schema, message, log_time=10**9 * (k + 100), sequence=k)
    writer.finish()
    path.write_bytes(content.getvalue())
    return path


@pytest.mark.parametrize(
    "header", [["time", "HeadPitch", "HeadYaw"], ["time", "HeadPitch.position", "HeadYaw.position"]]
)
def test_a_csv_of_some_joints_in_any_order(tmp_path, header):
    path = write_rows(tmp_path / "log.csv", header, TIMES, PITCH, YAW)
    found = read_joint_states(PEPPER, path)
    assert found.joint_names == PEPPER.joint_names
    assert found.duration == pytest.approx(0.5)
    position = found(np.clip(TIMES - 5.0, 0.0, found.duration)).position
    np.testing.assert_allclose(position[:, 3], YAW, atol=1e-12)
    np.testing.assert_allclose(position[:, 4], PITCH, atol=1e-12)
    np.testing.assert_array_equal(
        np.delete(position, [3, 4], axis=1), np.tile(np.delete(STAND, [3, 4]), (5, 1))
    )


def test_other_quantities_and_known_joints_of_the_robot_are_left_out(tmp_path):
    header = ["time", "HeadYaw.velocity", "HeadYaw.position", "LHand", "HeadYaw.torque"]
    path = write_rows(tmp_path / "log.csv", header, TIMES, PITCH, YAW, PITCH, PITCH)
    position = read_joint_states(PEPPER, path)(0.0).position
    np.testing.assert_array_equal(np.delete(position, 3), np.delete(STAND, 3))
    assert position[3] == 0.0


def test_what_the_twin_wrote_is_read(tmp_path):
    goal = PEPPER.joint_vector({"HeadYaw": 0.3, "LShoulderPitch": 1.2})
    run = pk.Twin(PEPPER).execute(pk.retime(PEPPER, [STAND, goal]))
    run.save(tmp_path / "run.csv")
    found = read_joint_states(PEPPER, tmp_path / "run.csv")
    np.testing.assert_allclose(found(run.time - run.time[0]).position, run.position, atol=1e-9)


def test_an_mcap_recording(tmp_path):
    messages = [
        (t, ["HeadPitch", "WheelB", "HeadYaw"], [p, 0.1, y])
        for t, p, y in zip(TIMES, PITCH, YAW, strict=True)
    ]
    messages[2] = (5.25, ["HeadYaw", "HeadPitch", "WheelB"], [YAW[2], PITCH[2], 0.1])
    found = read_joint_states(PEPPER, write_states(tmp_path / "log.mcap", messages))
    position = found(np.clip(TIMES - 5.0, 0.0, found.duration)).position
    np.testing.assert_allclose(position[:, 3], YAW, atol=1e-12)
    np.testing.assert_allclose(position[:, 4], PITCH, atol=1e-12)


def test_an_mcap_without_stamps_uses_the_times_of_recording(tmp_path):
    messages = [(0.0, ["HeadYaw"], [y]) for y in YAW]
    found = read_joint_states(PEPPER, write_states(tmp_path / "log.mcap", messages))
    np.testing.assert_allclose(found(np.arange(5.0)).position[:, 3], YAW, atol=1e-12)


def test_what_load_writes_is_a_recording_too(tmp_path):
    wave = pk.motion.gesture(PEPPER, "wave")
    pk.files.save(wave, tmp_path / "wave.mcap", dt=0.02)
    found = read_joint_states(PEPPER, tmp_path / "wave.mcap")
    times = np.arange(0.0, wave.duration, 0.02)[:-1]
    np.testing.assert_allclose(found(times).position, wave(times).position, atol=1e-9)


def test_a_step_is_reported(tmp_path):
    path = write_rows(tmp_path / "log.csv", ["time", "HeadYaw"], TIMES, [0, 0, 0, 1, 1])
    with pytest.warns(OvershootWarning, match="HeadYaw"):
        read_joint_states(PEPPER, path)
    calm = read_joint_states(PEPPER, path, interpolation="monotone")
    assert calm(np.linspace(0, calm.duration, 999)).position[:, 3].min() >= 0.0


def test_wrong_files_are_named(tmp_path):
    log = tmp_path / "log.csv"
    for header, columns, words in (
        (["time", "Tail"], (TIMES, YAW), "the robot has no joint 'Tail'"),
        (["time", "LHand"], (TIMES, YAW), "has no position of the robot's joints"),
        (["time", "HeadYaw", "HeadYaw.position"], (TIMES, YAW, YAW), "'HeadYaw' twice"),
        (["HeadYaw", "time"], (TIMES, YAW), "does not begin with 'time'"),
        (["time", "HeadYaw"], (TIMES[::-1], YAW), "does not come after"),
        (["time", "HeadYaw"], (TIMES, YAW * np.nan), "expected a finite number"),
        (["time", "HeadYaw"], (TIMES[:1], YAW[:1]), "one sample only"),
    ):
        with pytest.raises(FileFormatError, match=words):
            read_joint_states(PEPPER, write_rows(log, header, *columns))
    with pytest.raises(UnknownNameError, match=r"unknown suffix '.bag'; available: .csv, .mcap"):
        read_joint_states(PEPPER, tmp_path / "log.bag")


def test_wrong_recordings_are_named(tmp_path):
    path = tmp_path / "log.mcap"
    for messages, words in (
        ([(1.0, ["HeadYaw"], [0.1]), (1.0, ["HeadYaw"], [0.2])], "message 2 .* does not come after"),
        ([(1.0, ["HeadYaw"], [0.1]), (2.0, ["HeadPitch"], [0.2])], "message 2 .* has other joints"),
        ([(1.0, ["HeadYaw"], [np.nan]), (2.0, ["HeadYaw"], [0.2])], "message 1 .*HeadYaw is not finite"),
        ([(1.0, ["HeadYaw"], [0.1, 0.2]), (2.0, ["HeadYaw"], [0.2])], "2 positions for 1"),
        ([(1.0, [], [])], "holds no positions"),
    ):
        with pytest.raises(FileFormatError, match=words):
            read_joint_states(PEPPER, write_states(path, messages))
    write_states(path, [(1.0, ["HeadYaw"], [0.1]), (2.0, ["HeadYaw"], [0.2])])
    with pytest.raises(
        UnknownNameError, match="unknown topic with joint states '/arm'; available: /joint_states"
    ):
        read_joint_states(PEPPER, path, topic="/arm")
