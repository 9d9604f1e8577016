"""Recordings of messages of any type, against the reader and the writer of mcap_ros2."""

import io

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer
from test_cdr import NAMES, SIGNED_CHAR, SPECIAL, as_namespace, same

from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.ros_messages import Bag, BagWriter, message_type
from pepper_kin.ros_messages.schemas import schema_text, schema_type

TYPES = [name for name in NAMES if name not in (*SPECIAL, SIGNED_CHAR, "std_msgs/msg/Char")]

SECOND = 1_000_000_000


def topic_of(name):
    return "/" + name.replace("/", "_")


@pytest.fixture
def messages(filled):
    """Two random messages of every type, with topic and time [ns], in the order of time."""
    rng = np.random.default_rng(11)
    rows = [(topic_of(name), filled(message_type(name), rng)) for name in (*TYPES, *TYPES)]
    return [(topic, i * SECOND, message) for i, (topic, message) in enumerate(rows)]


def test_mcap_ros2_reads_every_type_that_is_written(messages, tmp_path):
    with BagWriter(tmp_path / "all.mcap") as bag:
        for topic, time, message in messages:
            bag.write(topic, message, time)
    found = list(read_ros2_messages(tmp_path / "all.mcap"))
    assert len(found) == len(messages)
    for theirs, (topic, time, message) in zip(found, messages, strict=True):
        assert (theirs.channel.topic, theirs.log_time_ns) == (topic, time)
        assert theirs.schema.name == message.type_name
        assert same(message, theirs.ros_msg)


def test_every_type_that_mcap_ros2_writes_is_read(messages, tmp_path):
    content = io.BytesIO()
    writer = Writer(content)
    schemas = {n: writer.register_msgdef(n, schema_text(message_type(n))) for n in TYPES}
    for topic, time, message in messages:
        writer.write_message(topic, schemas[message.type_name], as_namespace(message), log_time=time)
    writer.finish()
    (tmp_path / "all.mcap").write_bytes(content.getvalue())
    bag = Bag(tmp_path / "all.mcap")
    assert bag.topics == {topic_of(name): name for name in sorted(TYPES)}
    found = list(bag.messages())
    assert [(m.topic, m.time, m.message) for m in found] == messages
    assert all(type(m.message) is message_type(m.message.type_name) for m in found)


def test_a_type_of_another_package_is_read_by_its_text_and_written_again(tmp_path):
    """What the package does not define, with an array, a default and a type of its own within it."""
    text = (
        "uint8 LARGE=7\nstd_msgs/Header header\nmine/Part[] parts\nstring<=9 label 'none'\nfloat32[2] pair\n"
        + "=" * 80
        + "\nMSG: mine/Part\nint16[<=3] counts\nbool on true\n"
        + "=" * 80
        + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    )
    content = io.BytesIO()
    writer = Writer(content)
    schema = writer.register_msgdef("mine/msg/Whole", text)
    header = {"stamp": {"sec": 3, "nanosec": 4}, "frame_id": "torso"}
    parts = [{"counts": [1, -2], "on": False}, {"counts": [], "on": True}]
    values = {"header": header, "parts": parts, "label": "seven", "pair": [0.5, 0.25]}
    writer.write_message("/mine", schema, values, log_time=5)
    writer.finish()
    (tmp_path / "mine.mcap").write_bytes(content.getvalue())
    [(topic, time, message)] = Bag(tmp_path / "mine.mcap").messages()
    assert (topic, time, message.LARGE) == ("/mine", 5, 7)
    assert message.to_dict() == values
    with BagWriter(tmp_path / "again.mcap") as bag:
        bag.write(topic, message, time)
    [again] = read_ros2_messages(tmp_path / "again.mcap")
    assert same(message, again.ros_msg)


def test_a_package_s_type_with_other_fields_is_read_as_the_file_says(tmp_path):
    """An older version of a type: the file's definition counts."""
    content = io.BytesIO()
    writer = Writer(content)
    schema = writer.register_msgdef("std_msgs/msg/ColorRGBA", "float64 r\nstring name")
    writer.write_message("/color", schema, {"r": 0.5, "name": "red"}, log_time=0)
    writer.finish()
    (tmp_path / "old.mcap").write_bytes(content.getvalue())
    [(_, _, message)] = Bag(tmp_path / "old.mcap").messages()
    assert (message.r, message.name) == (0.5, "red")
    assert type(message) is not message_type("std_msgs/msg/ColorRGBA")


def test_topics_and_types_are_chosen(messages, tmp_path):
    with BagWriter(tmp_path / "all.mcap") as bag:
        for row in messages:
            bag.write(row[0], row[2], row[1])
    wanted = "sensor_msgs/msg/JointState"
    for chosen in ({"topics": [topic_of(wanted)]}, {"types": [wanted]}):
        found = list(Bag(tmp_path / "all.mcap").messages(**chosen))
        assert [m.message.type_name for m in found] == [wanted, wanted]


def text_message(text):
    return message_type("std_msgs/msg/String")(data=text)


def test_an_exception_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "run.mcap"
    with BagWriter(path) as bag:
        bag.write("/a", text_message("old"), 0)
    before = path.read_bytes()

    def fail():
        with BagWriter(path) as bag:
            bag.write("/a", text_message("new"), 0)
            raise OSError("of something else")

    with pytest.raises(OSError, match="of something else"):
        fail()
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_is_refused_by_name(tmp_path):
    with BagWriter(tmp_path / "a.mcap") as bag:
        bag.write("/a", text_message("a"), 0)
        with pytest.raises(FileFormatError, match=r"/a has std_msgs/msg/String, not std_msgs/msg/Empty"):
            bag.write("/a", message_type("std_msgs/msg/Empty")(), 1)
        with pytest.raises(InvalidValueError, match=r"time: got -1, expected nanoseconds"):
            bag.write("/a", text_message("a"), -1)
        with pytest.raises(InvalidValueError, match=r"String\.data"):
            bag.write("/b", text_message(5), 1)
    with pytest.raises(FileFormatError, match="is complete"):
        bag.write("/a", text_message("a"), 2)
    with pytest.raises(FileFormatError, match="cannot be written"):
        BagWriter(tmp_path / "none" / "a.mcap")
    [only] = Bag(tmp_path / "a.mcap").messages()
    assert only.message == text_message("a")


def test_a_definition_that_cannot_be_used_is_refused_with_its_topic(tmp_path):
    for text, reason in [
        ("string a\nstring a", "two fields or constants of the same name"),
        ("uint8 a=1\nstring a", "two fields or constants of the same name"),
        ("mine/Other a", "lacks the type mine/msg/Other"),
        ("mine/Text a", "contains itself"),
        ("string[", "TYPE NAME"),
        ("string a\n" + "=" * 80 + "\nMSG: a.b\nint8 c", "names a type 'a.b'"),
    ]:
        from mcap.writer import Writer as PlainWriter

        with (tmp_path / "odd.mcap").open("wb") as file:
            writer = PlainWriter(file)
            writer.start(profile="ros2", library="test")
            schema = writer.register_schema("mine/msg/Text", "ros2msg", text.encode())
            channel = writer.register_channel("/odd", "cdr", schema)
            writer.add_message(
                channel, log_time=7, data=b"\x00\x01\x00\x00\x01\x00\x00\x00\x00", publish_time=7
            )
            writer.finish()
        with pytest.raises(FileFormatError, match=rf"/odd: mine/msg/Text: .*{reason}"):
            list(Bag(tmp_path / "odd.mcap").messages(topics=["/odd"]))


def test_a_definition_is_read_from_its_own_text():
    for name in TYPES:
        assert schema_type(name, schema_text(message_type(name))) is message_type(name)
