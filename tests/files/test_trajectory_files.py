"""CSV files: exact round trips, atomic writing, and each way a file can be wrong."""

import json
import os

import numpy as np
import pytest

from pepper_kin.exceptions import FileFormatError, InvalidValueError, UnknownNameError
from pepper_kin.file_access import atomic_file
from pepper_kin.files import load_columns, load_table, save, save_table
from pepper_kin.files.csv_file import read_csv
from pepper_kin.trajectory import Trajectory


@pytest.fixture
def good(tmp_path):
    return save_table({"time": [0, 1, 2], "A.position": [0.1, 1 / 3, 1e-300]}, tmp_path / "t.csv")


def test_second_round_trip_is_exact(trajectory, tmp_path):
    first = save(trajectory, tmp_path / "a.csv", dt=0.01, unchecked=True)
    table = load_table(first)
    again = save_table(table, tmp_path / "b.csv")
    assert again.read_bytes() == first.read_bytes()


def test_header_and_companion(trajectory, tmp_path):
    path = save(trajectory, tmp_path / "trajectory.csv", dt=0.01, unchecked=True)
    names = trajectory.joint_names
    header = path.read_text().splitlines()[0].split(",")
    kinds = ("position", "velocity", "acceleration")
    assert header == ["time", *(f"{name}.{kind}" for kind in kinds for name in names)]
    columns = json.loads((tmp_path / "columns.json").read_text())
    assert list(columns) == header
    assert columns["time"] == {"unit": "s", "quantity": "time", "joint": None}
    assert columns["HeadYaw.velocity"] == {"unit": "rad/s", "quantity": "velocity", "joint": "HeadYaw"}


def test_tables_of_one_folder_share_the_companion(tmp_path):
    save_table({"time": [0.0], "A.position": [1.0]}, tmp_path / "a.csv")
    save_table({"time": [0.0], "B.torque": [1.0]}, tmp_path / "b.csv", joint_units={"B": "m"})
    columns = load_columns(tmp_path / "columns.json")
    assert set(columns) == {"time", "A.position", "B.torque"}
    assert columns["B.torque"]["unit"] == "N"


def test_meters_come_back(tmp_path):
    slide = Trajectory(("X", "R"), [0, 1], np.ones((1, 3, 2)), ("m", "rad"))
    assert read_csv(save(slide, tmp_path / "x.csv", dt=0.5)) == slide


def test_numbers_survive_exactly(good):
    np.testing.assert_array_equal(load_table(good)["A.position"], [0.1, 1 / 3, 1e-300])


def test_wrong_tables_are_refused_by_line(good):
    whole = good.read_text()
    for change, line, message in [
        (lambda t: t[:-1], 4, "is truncated: its last line does not end with a newline"),
        (lambda t: t.replace("1.0,0.3333333333333333", "1.0"), 3, "1 values for 2 columns"),
        (lambda t: t.replace("1e-300", "nan"), 4, "A.position is 'nan', expected a finite number"),
        (lambda t: t.replace("1e-300", "inf"), 4, "A.position is 'inf', expected a finite number"),
        (lambda t: t.replace("1e-300", "one"), 4, "A.position is 'one', expected a finite number"),
        (lambda t: t.replace("2.0,", "1.0,"), 4, "time 1.0 does not come after 1.0 of the line before"),
        (lambda t: t.replace("A.position", "A.color"), 1, "unknown column 'A.color'"),
        (lambda t: t.replace("A.position", "position"), 1, "unknown column 'position'"),
        (lambda t: t.replace("A.position", "A.position,A.position"), 1, "column 'A.position' occurs twice"),
        (lambda t: "x,y\n1,2\n", 1, "is not a table: its first line does not begin with 'time'"),
        (lambda t: "", 1, "is not a table"),
        (lambda t: "time,A.position\n", 1, "has no line of numbers"),
    ]:
        good.write_text(change(whole))
        with pytest.raises(FileFormatError) as caught:
            load_table(good)
        assert caught.value.line == line
        assert str(good) in str(caught.value)
        assert message in str(caught.value)


def test_columns_other_than_expected(good):
    for expected, message in [
        (["time", "A.position", "B.position"], "column 'B.position' is missing"),
        (["time"], "unknown column 'A.position'"),
    ]:
        with pytest.raises(FileFormatError, match=message):
            load_table(good, expected)


def test_reordered_trajectory_columns(pepper, trajectory, tmp_path):
    path = save(trajectory, tmp_path / "trajectory.csv", dt=0.01, unchecked=True)
    text = path.read_text()
    path.write_text(
        text.replace("KneePitch.velocity,HipPitch.velocity", "HipPitch.velocity,KneePitch.velocity")
    )
    with pytest.raises(
        FileFormatError, match=r"another order: 'HipPitch.velocity' where 'KneePitch.velocity'"
    ):
        read_csv(path)


def test_tables_that_are_no_trajectory(tmp_path):
    columns = {f"A.{q}": [0.0, 1.0] for q in ("position", "velocity", "acceleration")}
    late = save_table({"time": [1.0, 2.0], **columns}, tmp_path / "late.csv")
    with pytest.raises(FileFormatError, match=r"late.csv:2: time begins at .*1.0.*, expected 0"):
        read_csv(late)
    short = save_table({"time": [0.0], **{k: v[:1] for k, v in columns.items()}}, tmp_path / "short.csv")
    with pytest.raises(FileFormatError, match="has one line of numbers, expected at least 2"):
        read_csv(short)
    torque = save_table({"time": [0.0, 1.0], "A.torque": [0.0, 0.0]}, tmp_path / "torque.csv")
    with pytest.raises(FileFormatError, match=r"unknown column 'A.torque'"):
        read_csv(torque)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.csv: cannot be read: No such file"):
        read_csv(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"time,\xff\xfe\n")
    with pytest.raises(FileFormatError, match="is not text in UTF-8"):
        read_csv(tmp_path / "binary.csv")


@pytest.mark.parametrize(
    ("columns", "error", "message"),
    [
        ({"A.position": [0.0]}, InvalidValueError, "'time' as the first column"),
        ({"time": [0.0, 0.0]}, InvalidValueError, "times that increase"),
        ({"time": [0.0], "A.position": [np.nan]}, InvalidValueError, "A.position: got nan"),
        ({"time": [0.0], "A.position": [0.0, 1.0]}, InvalidValueError, "A.position: got shape"),
        ({"time": [0.0], "A": [0.0]}, InvalidValueError, "'<joint>.<quantity>'"),
        ({"time": [0.0], "A,B.position": [0.0]}, InvalidValueError, "without commas"),
        ({"time": [0.0], "A.mood": [0.0]}, UnknownNameError, "unknown quantity 'mood'; available: position"),
    ],
)
def test_wrong_columns_are_not_written(tmp_path, columns, error, message):
    with pytest.raises(error, match=message):
        save_table(columns, tmp_path / "t.csv")
    assert list(tmp_path.iterdir()) == []


def test_foreign_companion_is_kept(tmp_path):
    (tmp_path / "columns.json").write_text('{"mine": 1}')
    with pytest.raises(FileFormatError, match=r"columns.json: does not map columns"):
        save_table({"time": [0.0]}, tmp_path / "t.csv")
    assert [p.name for p in tmp_path.iterdir()] == ["columns.json"]
    (tmp_path / "columns.json").write_text("{\n oops")
    with pytest.raises(FileFormatError, match=r"columns.json:2: is not complete JSON"):
        load_columns(tmp_path / "columns.json")


def test_places_that_cannot_be_written(tmp_path):
    with pytest.raises(FileFormatError, match=r"nowhere/t.txt: cannot be written: No such file"):
        atomic_file.write_text(tmp_path / "nowhere" / "t.txt", "x")
    with pytest.raises(FileFormatError, match="it is a folder"):
        atomic_file.write_text(tmp_path, "x")


def test_permissions_are_the_usual_ones(tmp_path):
    plain = tmp_path / "plain"
    plain.write_text("x")
    ours = atomic_file.write_text(tmp_path / "ours", "x")
    assert ours.stat().st_mode == plain.stat().st_mode
    ours.chmod(0o600)
    atomic_file.write_bytes(ours, b"y")
    assert ours.stat().st_mode & 0o777 == 0o600


def test_a_mark_of_byte_order_is_no_fault(good):
    """Spreadsheets put one before what they save."""
    plain = load_table(good)
    good.write_bytes(b"\xef\xbb\xbf" + good.read_bytes())
    again = load_table(good)
    assert list(again) == list(plain)
    np.testing.assert_array_equal(again["A.position"], plain["A.position"])


def test_what_a_wrong_column_might_have_been_is_said(good):
    with pytest.raises(FileFormatError, match=r"unknown column 'A.position'; the joints are B$"):
        load_table(good, ["time", "B.position", "B.velocity"])
    with pytest.raises(FileFormatError, match=r"'A.position'; of A there can be velocity, torque$"):
        load_table(good, ["time", "A.velocity", "A.torque"])


def test_what_a_link_names_is_written_and_the_link_stays(tmp_path):
    (tmp_path / "kept").mkdir()
    target, link = tmp_path / "kept" / "t.txt", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    atomic_file.write_text(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    (tmp_path / "dangling").symlink_to(tmp_path / "made.txt")
    atomic_file.write_text(tmp_path / "dangling", "new")
    assert (tmp_path / "made.txt").read_text() == "new"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
def test_a_pipe_gets_the_content_and_stays(tmp_path):
    """A device is no other case: to root `-o /dev/null` must not be a file that takes its place."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        atomic_file.write_text(pipe, "all of it")
        assert os.read(reader, 100) == b"all of it"
    finally:
        os.close(reader)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs the device that is always full")
def test_a_full_device_is_refused_by_name(tmp_path):
    (tmp_path / "full").symlink_to("/dev/full")
    with pytest.raises(FileFormatError, match="full: cannot be written: No space left on device"):
        atomic_file.write_text(tmp_path / "full", "x" * 100_000)


def test_names_as_long_as_the_system_allows(tmp_path):
    for name in ("n" * 255, "\u00e9" * 127):
        assert atomic_file.write_text(tmp_path / name, "x").read_text() == "x"
    with pytest.raises(FileFormatError, match="cannot be written: File name too long"):
        atomic_file.check_file(tmp_path / ("n" * 256))


def test_the_mask_of_the_process_is_not_touched(tmp_path, monkeypatch):
    """It is one for all threads: files that others make meanwhile would be open to everybody."""
    monkeypatch.setattr(os, "umask", lambda mask: pytest.fail("the mask is changed"))
    atomic_file.write_text(tmp_path / "t.txt", "x")


def test_a_text_that_is_none_is_refused_by_the_file(tmp_path):
    with pytest.raises(FileFormatError, match=r"t.txt: cannot be written: character 1 .* surrogate"):
        atomic_file.write_text(tmp_path / "t.txt", "a\udce9")
    assert list(tmp_path.iterdir()) == []
