"""Logs from files: what is read, and what is refused by file, column and row."""

import lzma

import numpy as np
import pytest

from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.identification import RobotLog, read_log
from pepper_kin.twin import joint_response

JOINTS = ("LShoulderPitch", "LElbowRoll", "RShoulderPitch", "RElbowRoll", "HipPitch")


@pytest.fixture(scope="module")
def log(pepper, made_log):
    return made_log(pepper, joint_response(pepper), seconds=20.0)


def test_a_table_is_read_as_it_was_written(log, tmp_path, written):
    read = read_log(written(log, tmp_path / "person_x_session_1.csv"), commands_from=0.0)
    assert (read.joint_names, read.person, read.share) == (JOINTS, "x", 0.15)
    np.testing.assert_array_equal(read.measured, log.measured)
    np.testing.assert_array_equal(read.command, log.command)
    np.testing.assert_array_equal(read.reading_order, 2.5 + np.arange(5))


def test_a_compressed_table_is_the_same_and_early_commands_were_not_sent(log, tmp_path, written):
    plain = written(log, tmp_path / "a.csv")
    packed = tmp_path / "a.csv.xz"
    packed.write_bytes(lzma.compress(plain.read_bytes()))
    read = read_log(packed, share=0.3)
    assert read.share == 0.3
    assert read.command_time[0] >= 2.0 > log.time[0]
    assert read.time.size == log.time.size


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: rows[0].__setitem__(2, "other"), ("LShoulderPitch_measured", "is missing", ":1")),
        (lambda rows: rows[7].__setitem__(2, "nan"), ("LShoulderPitch_measured", "nan", ":8")),
        (lambda rows: rows[7].__setitem__(0, "0.0"), ("time", "does not come after", ":8")),
        (lambda rows: rows[9].__setitem__(4, "-37.5"), ("LElbowRoll_measured", "-37.5", "degrees", ":10")),
        (lambda rows: rows[9].pop(), ("10 values for 11 columns", ":10")),
    ],
)
def test_a_wrong_table_is_refused_by_column_and_row(log, tmp_path, change, words, written):
    path = written(log, tmp_path / "wrong.csv")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    change(rows)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    with pytest.raises(FileFormatError) as refused:
        read_log(path)
    assert "wrong.csv" in str(refused.value)
    for word in words:
        assert word in str(refused.value)


def test_milliseconds_are_refused_and_other_rates_read(log, tmp_path, written):
    slow = RobotLog("s", JOINTS, 1e3 * log.time, log.command, 1e3 * log.time, log.measured)
    with pytest.raises(FileFormatError, match="are these seconds"):
        read_log(written(slow, tmp_path / "slow.csv"))
    fast = RobotLog("f", JOINTS, 0.1 * log.time, log.command, 0.1 * log.time, log.measured)
    assert read_log(written(fast, tmp_path / "fast.csv"), commands_from=0.0).time.size == log.time.size


def test_other_files_are_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="suffix"):
        read_log(tmp_path / "a.txt")
    (tmp_path / "b.csv.xz").write_bytes(b"no archive at all")
    with pytest.raises(FileFormatError, match="is not xz"):
        read_log(tmp_path / "b.csv.xz")
    (tmp_path / "b.csv.xz").write_bytes(lzma.compress(b"time,A_command,A_measured\n" * 1000)[:-20])
    with pytest.raises(FileFormatError, match="is truncated"):
        read_log(tmp_path / "b.csv.xz")
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_log(tmp_path / "missing.csv")


def test_a_bomb_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("pepper_kin.identification.log_file.LARGEST", 1_000_000)
    (tmp_path / "bomb.csv.xz").write_bytes(lzma.compress(bytes(2_000_000)))
    with pytest.raises(FileFormatError, match="holds more than 1 MB"):
        read_log(tmp_path / "bomb.csv.xz")


def test_a_run_of_the_twin_is_a_log(pepper, tmp_path):
    import pepper_kin as pk

    run = pk.Twin(pepper).follow(np.tile(pepper.posture("Stand"), (200, 1)))
    read = read_log(run.save(tmp_path / "run.csv"))
    assert set(read.joint_names) == set(pepper.joint_names)
    np.testing.assert_allclose(
        read.measured[:, read.index("HipPitch")], run.position[:, pepper.joint_index("HipPitch")]
    )
    assert read.share == 1.0


def test_joint_states_on_two_topics_are_a_log(tmp_path, monkeypatch):
    import pepper_kin.identification.log_file as module
    from pepper_kin.files.joint_states import StateMessage

    states = [
        StateMessage(topic, int(1e9 * (k + late)), ("HeadYaw", "HeadPitch"), [0.1 * k, 0.0])
        for k in range(5)
        for topic, late in (("/joint_commands", 0.0), ("/joint_states", 0.05))
    ]

    class Entry:
        @staticmethod
        def load():
            return type("Format", (), {"read_states": staticmethod(lambda path: states)})

    monkeypatch.setattr(module, "plugins", lambda kind: {"mcap": Entry})
    read = read_log(tmp_path / "bag.mcap")
    np.testing.assert_allclose(read.command_time, np.arange(5.0))
    np.testing.assert_allclose(read.time, np.arange(5.0) + 0.05)
    np.testing.assert_allclose(read.measured[:, 0], 0.1 * np.arange(5))
    with pytest.raises(UnknownNameError, match="/other"):
        read_log(tmp_path / "bag.mcap", topic="/other")
    states[4].position[1] = 50.0
    with pytest.raises(FileFormatError, match="message 3 of /joint_commands: position of HeadPitch is 50"):
        read_log(tmp_path / "bag.mcap")


def test_lost_readings_are_not_valid():
    time = np.arange(8.0)
    measured = np.array([[1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.02, 0.0]]).T
    log = RobotLog("x", ("HipPitch",), time, measured, time, measured)
    assert log.arrived()[:, 0].tolist() == [True, False, True, False, False, True, True, True]


def test_a_wrong_log_is_refused():
    for changed, words in [
        ({"share": 0.0}, "share"),
        ({"time": np.array([0.0, 0.0, 1.0])}, "time"),
        ({"measured": np.zeros((3, 2))}, "measured"),
        ({"measured": np.array([[0.0], [np.nan], [0.0]])}, "measured"),
    ]:
        fields = {
            "name": "x",
            "joint_names": ("HipPitch",),
            "command_time": np.arange(3.0),
            "command": np.zeros((3, 1)),
            "time": np.arange(3.0),
            "measured": np.zeros((3, 1)),
        }
        with pytest.raises(InvalidValueError, match=words):
            RobotLog(**{**fields, **changed})
