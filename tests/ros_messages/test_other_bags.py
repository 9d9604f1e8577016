"""Recordings as others write them: MCAP files of every layout, both byte orders, bags of rosbags and rosbag2.

The files of rosbag2's form in `data/` were written by rosbags, as text; values are those that it was given.
"""

import io
import itertools
import shutil
import sqlite3
from functools import partial
from pathlib import Path

import mcap_ros2._dynamic as dynamic
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2._cdr import CdrWriter, EncapsulationKind
from test_cdr import NAMES, SIGNED_CHAR, SPECIAL, as_namespace, schema

from pepper_kin.exceptions import FileFormatError, FileFormatWarning, UnknownNameError
from pepper_kin.files import load, read_joint_states
from pepper_kin.ros_messages import Bag, BagWriter, MessageError, decode, encode, message_type
from pepper_kin.ros_messages.schemas import schema_text, schema_type

DATA = Path(__file__).parent / "data"
ONE_AND_A_HALF = b"\x00\x01\x00\x00" + np.float64(1.5).tobytes()
FLAGS = ("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets", "use_chunking")


def write_mcap(path, topics, **options):
    """Write messages of 8 bytes: rows of topic, type, text, syntax, encoding, time [ns]."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2", library="test")
        for topic, kind, text, syntax, encoding, time in topics:
            number = writer.register_schema(kind, syntax, text.encode())
            channel = writer.register_channel(topic, encoding, number)
            writer.add_message(channel, log_time=time, data=ONE_AND_A_HALF, publish_time=time)
        writer.finish()
    return path


def test_mcap_files_are_read_with_any_part_of_their_summary(tmp_path):
    """Every combination of what the format calls optional; messages out of order in the file."""
    rows = [(f"/{i}", f"x/msg/M{i}", "float64 data", "ros2msg", "cdr", t) for i, t in enumerate((5, 3, 4))]
    indexes = (IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE | IndexType.CHUNK, IndexType.ALL)
    for chosen in itertools.product((False, True), repeat=len(FLAGS)):
        options = dict(zip(FLAGS, chosen, strict=True))
        for index, compression in itertools.product(indexes, (CompressionType.NONE, CompressionType.ZSTD)):
            layout = {"index_types": index, "compression": compression, "chunk_size": 40, **options}
            bag = Bag(write_mcap(tmp_path / "run.mcap", rows, **layout))
            read = [(topic, time, message.data) for topic, time, message in bag.messages()]
            assert read == [("/1", 3, 1.5), ("/2", 4, 1.5), ("/0", 5, 1.5)], layout
            assert bag.topics == {"/0": "x/msg/M0", "/1": "x/msg/M1", "/2": "x/msg/M2"}, layout


def test_big_endian_messages_of_every_type_are_read(filled, monkeypatch):
    """As mcap_ros2 writes them."""
    monkeypatch.setattr(dynamic, "CdrWriter", partial(CdrWriter, kind=EncapsulationKind.CDR_BE))
    rng = np.random.default_rng(5)
    for name in NAMES:
        if name in (*SPECIAL, SIGNED_CHAR, "std_msgs/msg/Char"):
            continue
        message = filled(message_type(name), rng)
        write = dynamic.serialize_dynamic(name, schema(name))[name]
        data = bytes(write(as_namespace(message)))
        assert data[:2] == b"\x00\x00"
        read = decode(message_type(name), data)
        assert read == message, name
        assert encode(read) == encode(message), name
        for cut in range(4, min(len(data), 60), 7):
            try:
                decode(message_type(name), data[:cut])
            except MessageError:
                continue


@pytest.mark.parametrize(
    "word", ["from", "class", "None", "self", "definition", "nested", "to_dict", "type_name"]
)
def test_fields_named_as_words_of_python_or_of_the_class(word, tmp_path):
    """Named with "_" behind, as rosbags names them; the field's own name stays in JSON and in definitions."""
    rows = [("/a", "x_msgs/msg/K", f"float64 {word}", "ros2msg", "cdr", 1)]
    [(_, _, message)] = Bag(write_mcap(tmp_path / "a.mcap", rows)).messages()
    assert getattr(message, f"{word}_") == 1.5
    assert type(message)(**{f"{word}_": 1.5}) == message == type(message).from_dict({word: 1.5})
    assert message.to_dict() == {word: 1.5}
    assert schema_text(type(message)) == f"float64 {word}\n"
    with BagWriter(tmp_path / "b.mcap") as bag:
        bag.write("/a", message, 1)
    [(_, _, again)] = Bag(tmp_path / "b.mcap").messages()
    assert again == message


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("bool[3] a [false, true, False]", [False, True, False]),
        ("bool[] a [true]", [True]),
        ("float64[2] a [.5, 1e3]", [0.5, 1000.0]),
        ("uint8[<=3] a [1, 0xff]", [1, 255]),
        ("string[] a ['x', \"true\"]", ["x", "true"]),
        ("string a [none]", "[none]"),
        ("bool a TRUE", True),
        ("char a 200", 200),
        ("bool[2] a [1, 0]", [True, False]),
    ],
)
def test_defaults_are_read_and_written_again(text, value):
    """As in rosidl's test_interface_files: the value, and a definition that says the same."""
    kind = schema_type("x_msgs/msg/X", text + "\n")
    found = kind().a
    assert (found.tolist() if isinstance(found, np.ndarray) else found) == value
    again = schema_type("x_msgs/msg/X", schema_text(kind))()
    assert again.to_dict() == kind().to_dict()


@pytest.mark.parametrize(
    "text",
    ["uint8 a 256", "int8[] a [1, -129]", "int32 a 1.5", "float64[2] a 1", "float64 a [1]", "bool a 2"],
)
def test_defaults_that_the_type_cannot_hold_are_refused(text):
    with pytest.raises(MessageError, match="x_msgs/msg/X: definition has the value"):
        schema_type("x_msgs/msg/X", text)


def test_what_cannot_be_read_is_named_and_the_rest_is_read(tmp_path):
    """A chosen topic is refused with the reason; where none is chosen, it is left out with a warning."""
    rows = [
        ("/good", "std_msgs/msg/Float64", "float64 data", "ros2msg", "cdr", 1),
        ("/known", "std_msgs/msg/Float64", "", "", "cdr", 2),
        ("/idl", "x/msg/A", "struct A { double data; };", "ros2idl", "cdr", 3),
        ("/one", "x/B", "float64 data", "ros1msg", "ros1", 4),
        ("/json", "x/C", "{}", "jsonschema", "json", 5),
        ("/lost", "x/msg/D", "", "", "cdr", 6),
        ("/wide", "x/msg/E", "wstring data", "ros2msg", "cdr", 7),
        ("/lacks", "x/msg/F", "x/Other data", "ros2msg", "cdr", 8),
    ]
    reasons = {
        "/idl": "'ros2idl'", "/one": "stored as 'ros1'", "/json": "'json'", "/lost": "no definition of it",
        "/wide": "wstring", "/lacks": "lacks the type x/msg/Other",
    }  # fmt: skip
    bag = Bag(write_mcap(tmp_path / "run.mcap", rows))
    with pytest.warns(FileFormatWarning) as caught:
        read = [(topic, message.data) for topic, _, message in bag.messages()]
    assert read == [("/good", 1.5), ("/known", 1.5)]
    for topic, reason in reasons.items():
        assert any(topic in str(w.message) and reason in str(w.message) for w in caught), topic
        with pytest.raises(FileFormatError, match=rf"run.mcap: {topic}: .*{reason}"):
            list(bag.messages(topics=[topic]))
    with pytest.raises(UnknownNameError, match="'/nope'"):
        list(bag.messages(topics=["/nope"]))


def database(path):
    """Write the bag of rosbags as a `.db3` file."""
    connection = sqlite3.connect(path)
    connection.executescript((DATA / "rosbags_bag.sql").read_text("utf-8"))
    connection.close()
    return path


def folder(path, mode="", names=("run.db3",)):
    """Make a bag's folder around the `.db3` file, compressed by "file" or "message"."""
    path.mkdir()
    file = database(path / "run.db3")
    stated = (DATA / "rosbags_metadata.yaml").read_text("utf-8")
    if mode:
        stated = stated.replace("compression_mode: ''", f"compression_mode: {mode}")
        stated = stated.replace("compression_format: ''", "compression_format: zstd")
    if mode == "FILE":
        (path / "run.db3.zstd").write_bytes(zstandard.compress(file.read_bytes()))
        file.unlink()
        stated = stated.replace("  - run.db3\n", "  - run.db3.zstd\n")
    if mode == "MESSAGE":
        connection = sqlite3.connect(file)
        for number, data in connection.execute("SELECT id, data FROM messages").fetchall():
            packed = zstandard.compress(data)
            connection.execute("UPDATE messages SET data = ? WHERE id = ?", (packed, number))
        connection.commit()
        connection.close()
    (path / "metadata.yaml").write_text(stated)
    return path


@pytest.mark.parametrize("form", ["db3", "", "FILE", "MESSAGE"])
def test_bags_of_rosbags_are_read(form, pepper, tmp_path):
    path = database(tmp_path / "run.db3") if form == "db3" else folder(tmp_path / "bag", form)
    bag = Bag(path)
    assert bag.topics == {"/joint_states": "sensor_msgs/msg/JointState", "/word": "mine/msg/Word"}
    rows = list(bag.messages())
    assert [time for _, time, _ in rows] == [0, 1_000_000_000, 2_000_000_000, 2_500_000_000, 3_000_000_000]
    [word] = [message for topic, _, message in rows if topic == "/word"]
    assert word.to_dict() == {"from": 1.5, "flags": [True, False], "steps": [1, -2, 3]}
    motion = read_joint_states(pepper, path)
    assert motion.duration == 3.0
    yaw, pitch = (motion(2.0).position[pepper.joint_index(name)] for name in ("HeadYaw", "HeadPitch"))
    assert (yaw, pitch) == pytest.approx((0.2, -0.1))
    with pytest.raises(FileFormatError, match="only: mine/msg/Word, sensor_msgs/msg/JointState"):
        load(path, pepper=pepper)


def test_a_bag_in_several_files_is_read_in_the_order_of_times(tmp_path):
    place = folder(tmp_path / "bag")
    rows = [("/late", "x/msg/M", "float64 data", "ros2msg", "cdr", t) for t in (1_500_000_000, 9_000_000_000)]
    shutil.rmtree(place)
    place.mkdir()
    stated = (DATA / "rosbags_metadata.yaml").read_text("utf-8").replace("sqlite3", "mcap")
    names = "".join(f"  - bag/{k}.mcap\n" for k in range(2))  # early versions named the folder, too
    (place / "metadata.yaml").write_text(stated.replace("  - run.db3\n", names))
    write_mcap(place / "0.mcap", rows)
    write_mcap(place / "1.mcap", [("/other", *row[1:5], 2_000_000_000) for row in rows[:1]])
    times = [time for _, time, _ in Bag(place).messages()]
    assert times == [1_500_000_000, 2_000_000_000, 9_000_000_000]
    (place / "1.mcap").unlink()
    with pytest.raises(FileFormatError, match=r"lacks 1\.mcap, which metadata\.yaml names"):
        Bag(place)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("sqlite3", "rosbag_v9", "has the storage 'rosbag_v9'"),
        ("compression_mode: ''", "compression_mode: FILE", "has the compression 'file' by ''"),
        ("relative_file_paths", "others", "has no list relative_file_paths"),
        ("rosbag2_bagfile_information", "x", "has no rosbag2_bagfile_information"),
        ("files:", "[files", "is not YAML"),
    ],
)
def test_a_folder_of_another_kind_is_refused(old, new, reason, tmp_path):
    place = folder(tmp_path / "bag")
    text = (place / "metadata.yaml").read_text()
    (place / "metadata.yaml").write_text(text.replace(old, new, 1))
    with pytest.raises(FileFormatError, match=reason):
        Bag(place)


def test_what_is_no_bag_is_refused(tmp_path):
    (tmp_path / "text.db3").write_text("no database, but text that is long enough to be looked at\n" * 9)
    sqlite3.connect(tmp_path / "empty.db3").executescript("CREATE TABLE a(b)")
    for name, reason in [
        ("none.db3", "cannot be read"),
        ("text.db3", "is not a complete SQLite file"),
        ("empty.db3", "lacks the tables topics and messages"),
        ("", "is a folder without metadata.yaml"),
    ]:
        with pytest.raises(FileFormatError, match=reason):
            Bag(tmp_path / name)


def test_a_time_of_zero_is_a_time_where_other_headers_are_set(pepper, tmp_path):
    """Simulated time begins at 0; recorders stamp messages a little later than their headers."""
    kind = message_type("sensor_msgs/msg/JointState")
    for stamps, duration in (((0, 1, 2), 2.0), ((0, 0, 0), 2.5)):
        with BagWriter(tmp_path / "run.mcap") as bag:
            for i, stamp in enumerate(stamps):
                message = kind(name=["HeadYaw"], position=[0.1 * i])
                message.header.stamp.sec = stamp
                bag.write("/joint_states", message, round((0.3 + 1.25 * i) * 1e9))
        assert read_joint_states(pepper, tmp_path / "run.mcap").duration == duration
    content = io.BytesIO((tmp_path / "run.mcap").read_bytes()[:-30])
    (tmp_path / "cut.mcap").write_bytes(content.getvalue())
    with pytest.raises(FileFormatError, match="is not a complete MCAP file"):
        read_joint_states(pepper, tmp_path / "cut.mcap")
