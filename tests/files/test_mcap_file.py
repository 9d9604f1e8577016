"""MCAP files: read by their own library, and refused by name."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError
from pepper_kin.files import load, read_joint_states, save
from pepper_kin.ros_messages import recorded


@pytest.fixture(scope="module")
def trajectory():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    return pk.retime(pepper, [q, q + 0.1 * (np.arange(pepper.n) % 3 == 2)])


def test_mcap_is_read_by_its_library(trajectory, tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    path = save(trajectory, tmp_path / "motion.mcap", unchecked=True)
    samples = trajectory.sample(0.01)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        topics = {channel.topic for channel in summary.channels.values()}
        assert reader.get_header().profile == "ros2"
        states = list(reader.iter_decoded_messages(topics="/joint_states"))
    assert topics == {"/joint_states", "/joint_trajectory"}
    # What Foxglove and ROS 2 know messages by.
    names = {"sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"}
    assert {s.name for s in summary.schemas.values()} == names
    assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert len(states) == len(samples)
    for i in (0, 7, len(samples) - 1):
        found = states[i]
        assert found.message.log_time == round(samples.time[i] * 1e9)
        assert tuple(found.decoded_message.name) == trajectory.joint_names
        np.testing.assert_allclose(found.decoded_message.position, samples.position[i], atol=1e-8)


def test_mcap_without_a_trajectory_says_what_it_holds(tmp_path):
    from mcap_ros2.writer import Writer

    with (tmp_path / "text.mcap").open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/talk", schema, {"data": "hello"}, log_time=0)
        writer.finish()
    with pytest.raises(FileFormatError, match=r"only: std_msgs/msg/String"):
        load(tmp_path / "text.mcap")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda m: m["points"][1]["positions"].__setitem__(0, np.nan),
            "point 2 has positions that are not finite",
        ),
        (lambda m: m["points"].reverse(), "time begins at 1.0 s"),
        (lambda m: m["points"][1]["positions"].pop(), "point 2 has 0 positions for 1 joints"),
        (lambda m: m["points"].pop(), "has 1 points, expected at least 2"),
        (lambda m: m["joint_names"].append("A"), "joint 'A' occurs twice"),
        (lambda m: [p["positions"].clear() for p in m["points"]], "points have no positions"),
        (lambda m: [p["velocities"].clear() for p in m["points"]], "accelerations but no velocities"),
    ],
)
def test_wrong_mcap(tmp_path, change, message):
    from mcap_ros2.writer import Writer

    from pepper_kin.ros_messages import message_type
    from pepper_kin.ros_messages.schemas import schema_text

    name = "trajectory_msgs/msg/JointTrajectory"
    text = schema_text(message_type(name))

    def point(sec):
        lists = {name: [float(sec)] for name in ("positions", "velocities", "accelerations")}
        return {**lists, "effort": [], "time_from_start": {"sec": sec, "nanosec": 0}}

    content = {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": ["A"],
        "points": [point(0), point(1)],
    }
    change(content)
    with (tmp_path / "wrong.mcap").open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef(name, text)
        writer.write_message("/t", schema, content, log_time=0)
        writer.finish()
    with pytest.raises(FileFormatError, match=message):
        load(tmp_path / "wrong.mcap")


@pytest.mark.parametrize("compression", ["ZSTD", "LZ4"])
def test_a_small_recording_that_takes_all_memory_is_refused(pepper, tmp_path, monkeypatch, compression):
    """91 KB took 3 GB."""
    from mcap import writer as mcap

    monkeypatch.setattr(recorded, "MOST_BYTES", 10_000_000)
    path = tmp_path / "bomb.mcap"
    for count in (8, 12):  # messages of a megabyte each
        writer = mcap.Writer(
            str(path), compression=getattr(mcap.CompressionType, compression), chunk_size=1 << 40
        )
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"float64[] position")
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for time in range(count):
            writer.add_message(channel, time, bytes(1_000_000), time)
        writer.finish()
        reason = "is more than 10000000 bytes when decompressed" if count > 10 else "with other fields"
        with pytest.raises(FileFormatError, match=f"bomb.mcap: .*{reason}"):
            read_joint_states(pepper, path)
