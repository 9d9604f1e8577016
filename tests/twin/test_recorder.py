"""Recordings: whole, resumable, the same to the last bit, and readable by others."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.twin import Recorder, load_recording
from pepper_kin.twin.packing import (
    pack,
    pack_moved,
    pack_together,
    unpack,
    unpack_moved,
    unpack_together,
)
from pepper_kin.twin.sensors import SensorSuite

PEPPER = pk.load_pepper()


def twin(seed=0, sensors=True, timestep=0.002, **options):
    suite = (
        SensorSuite(PEPPER, seed=seed, sensors=("joint_encoders", "imu_torso_gyroscope")) if sensors else None
    )
    return pk.Twin(PEPPER, timestep, sensors=suite, **options)


def wave(seconds=1.3, timestep=0.002):
    steps = np.arange(1, round(seconds / timestep) + 1)[:, None] * timestep
    return PEPPER.neutral() + 0.1 * np.sin(2 * steps) * np.eye(PEPPER.n)[PEPPER.joint_index("HeadYaw")]


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(
        np.float64,
        hnp.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=9),
        elements=st.floats(allow_nan=True, width=64),
    )
)
def test_packing_keeps_every_bit(values):
    again = unpack(pack(values))
    assert again.shape == values.shape
    assert np.array_equal(again.view(np.uint64), values.view(np.uint64))


def test_positions_follow_from_velocities_to_the_last_bit():
    run = twin(sensors=False).follow(wave(0.4))
    steps = (run.velocity[1:], run.position[0], 0.002)
    packed = pack_moved(run.position[1:], *steps)
    assert np.array_equal(unpack_moved(packed, *steps).view(np.uint64), run.position[1:].view(np.uint64))
    assert len(packed) < 0.05 * run.position.nbytes
    other = np.random.default_rng(0).normal(size=(30, 3)) * 10.0 ** np.arange(-3, 0)
    assert np.array_equal(unpack_moved(pack_moved(other, other, other[0], 0.1), other, other[0], 0.1), other)


def test_packing_keeps_other_kinds_and_refuses_damage():
    picture = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    assert np.array_equal(unpack(pack(picture)), picture)
    smooth = np.sin(np.linspace(0, 1, 1000))[:, None]
    assert len(pack(smooth)) < 0.7 * smooth.nbytes
    with pytest.raises(InvalidValueError, match="packed series"):
        unpack(pack(smooth)[:-5])
    many = {"b": (["m", "line\nbreak"], [pack(smooth), pack(picture)]), "a": ([], [pack(smooth[:0])])}
    for name, (about, parts) in unpack_together(pack_together(many)).items():
        assert about == many[name][0]
        assert all(np.array_equal(x, y) for x, y in zip(parts, many[name][1], strict=True))
    assert unpack_together(pack_together({})) == {}
    with pytest.raises(InvalidValueError, match="packed series"):
        unpack_together(pack_together(many)[:-5])


def test_readings_that_are_members_of_their_own_are_still_read(tmp_path):
    """As recordings were written before their readings were packed together."""
    recorder = Recorder(twin(), tmp_path / "r")
    recorder.follow(wave(0.3))
    now, path = recorder.recording.readings(), tmp_path / "r" / "000000.npz"
    with np.load(path) as data:
        members = {name: data[name] for name in data.files}
    for name, (about, parts) in unpack_together(members.pop("readings")).items():
        members[f"about.{name}"] = np.array(about)
        members |= {f"{what}.{name}": x for what, x in zip(("time", "value", "truth"), parts, strict=True)}
    np.savez(path, **members)
    before = recorder.recording.readings()
    assert before.keys() == now.keys()
    assert len(now) == 2
    for name, series in before.items():
        assert np.array_equal(series.value, now[name].value)
        assert (series.unit, series.frame) == (now[name].unit, now[name].frame)


def test_a_recording_holds_what_the_run_was(tmp_path):
    recorder = Recorder(twin(), tmp_path / "r", chunk=0.5, seed=0)
    run = recorder.follow(wave())
    found = recorder.recording
    assert found.chunks == 3
    again = found.run()
    for name in ("time", "position", "velocity", "torque", "reference_position", "reference_velocity"):
        assert np.array_equal(getattr(again, name)[1:], getattr(run, name)[1:]), name
    assert set(again.readings) == {"joint_encoders", "imu_torso_gyroscope"}
    for name, series in again.readings.items():
        assert np.array_equal(series.time, run.readings[name].time)
        assert np.array_equal(series.value, run.readings[name].value)
        assert np.all(np.diff(series.time) > 0)
    # In pieces or in one go: the same motion to the last bit.
    whole = twin().follow(wave())
    assert np.array_equal(whole.position, run.position)


def test_replay_is_the_same_to_the_last_bit_and_another_seed_or_step_is_not(tmp_path):
    recorder = Recorder(twin(), tmp_path / "r")
    recorder.follow(wave(0.6))
    found = recorder.recording
    found.replay(twin())
    other = pk.twin.actuator_parameters(PEPPER)
    heavier = other.changed(damping=1.001 * np.asarray(other.damping))
    with pytest.raises(InvalidValueError, match=r"position of \w+ at step \d+ .*to the last bit"):
        found.replay(twin(actuators=heavier))
    with pytest.raises(InvalidValueError, match="timestep of the twin"):
        found.replay(twin(timestep=0.001))
    with pytest.raises(InvalidValueError, match="sensors of the twin"):
        found.replay(twin(sensors=False))


def test_pushes_are_recorded_too(tmp_path):
    pushed = twin(sensors=False)
    recorder = Recorder(pushed, tmp_path / "r", chunk=0.2)
    pushed.push("LArm_effector", (5.0, 0.0, 0.0), start=0.1, duration=0.3)
    run = recorder.follow(np.tile(PEPPER.neutral(), (300, 1)))
    calm = twin(sensors=False).follow(np.tile(PEPPER.neutral(), (300, 1)))
    assert np.abs(run.position - calm.position).max() > 1e-5
    recorder.recording.replay(twin(sensors=False))


def test_a_killed_process_leaves_whole_seconds_that_are_taken_up_again(tmp_path):
    folder = tmp_path / "r"
    (tmp_path / "job.py").write_text(
        textwrap.dedent(f"""
        import numpy as np, pepper_kin as pk
        from pepper_kin.twin import Recorder
        pepper = pk.load_pepper()
        steps = np.arange(1, 500_001)[:, None] * 0.002
        target = pepper.neutral() + 0.1 * np.sin(2 * steps) * np.eye(pepper.n)[3]
        Recorder(pk.Twin(pepper, 0.002), {str(folder)!r}).follow(target)
        """)
    )
    process = subprocess.Popen([sys.executable, str(tmp_path / "job.py")])
    deadline = time.monotonic() + 120
    while not (folder / "000001.npz").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()

    found = load_recording(folder)
    assert found.chunks >= 2
    assert len(found.run()) == 500 * found.chunks + 1
    steps = np.arange(1, 500 * (found.chunks + 1) + 1)[:, None] * 0.002
    target = PEPPER.neutral() + 0.1 * np.sin(2 * steps) * np.eye(PEPPER.n)[3]
    recorder = Recorder.resume(twin(sensors=False), folder)
    assert recorder.time == pytest.approx(found.chunks)
    recorder.follow(target[500 * found.chunks :])
    never_killed = twin(sensors=False).follow(target)
    assert np.array_equal(recorder.recording.run().position, never_killed.position)


def test_execute_goes_on_with_its_trajectory_after_a_resume(tmp_path):
    path = [PEPPER.neutral(), PEPPER.joint_vector({"HeadYaw": 0.9})]
    trajectory = pk.retime(PEPPER, path, solver="toppra")
    one = Recorder(twin(), tmp_path / "whole", chunk=0.1)
    one.execute(trajectory, hold_time=0.2)
    Recorder(twin(), tmp_path / "parts", chunk=0.1).execute(trajectory, hold_time=0.2)
    chunks = sorted((tmp_path / "parts").glob("0*.npz"))
    for late in chunks[3:]:
        late.unlink()
    two = Recorder.resume(twin(), tmp_path / "parts")
    two.execute(trajectory, hold_time=0.2)
    first, second = one.recording.run(), two.recording.run()
    assert np.array_equal(first.position, second.position)
    for name in first.readings:
        assert np.array_equal(first.readings[name].value, second.readings[name].value)


def test_files_for_other_programs(tmp_path):
    recorder = Recorder(twin(), tmp_path / "r")
    recorder.follow(wave(0.3))
    found, run = recorder.recording, recorder.recording.run()
    with np.load(found.save(tmp_path / "r.npz")) as data:
        assert np.array_equal(data["position"], run.position)
        assert np.array_equal(data["reading.joint_encoders.value"], run.readings["joint_encoders"].value)
    table = pk.twin.load_run(PEPPER, found.save(tmp_path / "r.csv"))
    assert table.position == pytest.approx(run.position, abs=1e-12)

    from mcap_ros2.reader import read_ros2_messages

    states = list(read_ros2_messages(found.save(tmp_path / "r.mcap"), topics=["/joint_states"]))
    assert len(states) == len(run)
    assert np.allclose(states[-1].ros_msg.position, run.position[-1], atol=0)
    gyro = list(read_ros2_messages(tmp_path / "r.mcap", topics=["/sensors/imu_torso_gyroscope"]))
    assert np.allclose([m.ros_msg.data for m in gyro], run.readings["imu_torso_gyroscope"].value)
    with pytest.raises(FileFormatError, match=r"\.txt.*\.mcap"):
        found.save(tmp_path / "r.txt")


def test_what_is_no_recording_is_named(tmp_path):
    with pytest.raises(FileFormatError, match="no recording here"):
        load_recording(tmp_path)
    (tmp_path / "recording.json").write_text("{}")
    with pytest.raises(FileFormatError, match="the header lacks format, robot"):
        load_recording(tmp_path)
    recorder = Recorder(twin(sensors=False), tmp_path / "r")
    with pytest.raises(FileFormatError, match="holds a recording already"):
        Recorder(twin(sensors=False), tmp_path / "r")
    with pytest.raises(InvalidValueError, match="no rows"):
        recorder.follow(np.empty((0, PEPPER.n)))
    recorder.follow(wave(0.1))
    chunk = tmp_path / "r" / "000000.npz"
    chunk.write_bytes(chunk.read_bytes()[:-200])
    with pytest.raises(FileFormatError, match=r"000000\.npz.*not a complete"):
        recorder.recording.run()


def test_a_minute_of_gestures_with_sensors_takes_less_than_20_megabytes(tmp_path):
    wave_once = pk.motion.gesture(PEPPER, "explain")
    small = twin(timestep=0.001)
    small.reset(wave_once.start)
    recorder = Recorder(small, tmp_path / "r")
    run = recorder.execute(wave_once)
    assert recorder.recording.size * 60 / run.duration < 20e6


def test_a_run_that_stops_at_once_is_recorded_with_its_reason(tmp_path):
    wild = pk.twin.actuator_parameters(PEPPER).changed(
        mode="torque", torque_limit=np.inf, stop_stiffness=0.0, stop_damping=0.0
    )
    thrown = twin(sensors=False, actuators=wild)
    thrown.reset(v=np.full(PEPPER.n, 900.0))
    recorder = Recorder(thrown, tmp_path / "r", chunk=0.002)
    run = recorder.follow(np.tile(PEPPER.neutral(), (300, 1)))
    assert not run.success
    found = recorder.recording.run()
    assert found.status.value == "stopped"
    assert found.message == run.message
    assert len(found) == len(run)
    recorder.recording.replay(twin(sensors=False, actuators=wild))
