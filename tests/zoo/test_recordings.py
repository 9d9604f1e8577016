"""Recordings of random message types, in both directions against mcap_ros2, and LeRobot sets by its rules."""

import io
import json
from functools import partial

import mcap_ros2._dynamic as dynamic
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from mcap_ros2._cdr import CdrWriter, EncapsulationKind
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer
from random_messages import random_message

from pepper_kin.datasets import Feature, LeRobotWriter
from pepper_kin.ros_messages import Bag, BagWriter
from pepper_kin.ros_messages.definitions import PRIMITIVES
from pepper_kin.ros_messages.schemas import schema_text, schema_type

WORDS = ("from", "class", "self", "definition", "data", "x1", "lambda", "nested", "match", "end")
BASES = (*PRIMITIVES, "string", "string<=5", "odd/Part", "geometry_msgs/Point")
ARRAYS = ("", "", "[]", "[3]", "[<=4]")
DEFAULTS = {
    "bool": ("true", "false"),
    "string": ("'a b'", "plain"),
    "float64": (".5", "1e3"),
    "uint8": ("7", "0xff"),
}
POINT = "\n" + "=" * 80 + "\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"


def random_definition(rng) -> str:
    """Return the text of a type with a type within it."""

    def lines(nested: bool) -> str:
        rows = []
        for word in rng.permutation(WORDS)[: rng.integers(1, 8)]:
            base = str(rng.choice(BASES if nested else BASES[:-2]))
            array = str(rng.choice(ARRAYS))
            default = ""
            if not array and base in DEFAULTS and rng.random() < 0.4:
                default = f" {rng.choice(DEFAULTS[base])}"
            rows.append(f"{base}{array} {word}{default}  # a comment\n")
        return "".join(rows)

    return lines(True) + "=" * 80 + "\nMSG: odd/Part\nuint8 LARGE=7\n" + lines(False) + POINT


def plain(value):
    """Return what mcap_ros2 has read as `to_dict` has it, but for base64."""
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return [plain(one) for one in value] if isinstance(value, (list, tuple)) else value


def values_of(message):
    """Return a message as plain values by the fields' own names."""
    found = {}
    for field in message.definition.fields:
        value = getattr(message, field.attribute)
        if field.nested:
            value = values_of(value) if field.array is None else [values_of(one) for one in value]
        found[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return found


def test_recordings_of_random_types(amount, rng, tried, tmp_path, monkeypatch):
    """mcap_ros2 writes, in both byte orders and with any part of a summary, what is read; it reads ours."""
    path = tmp_path / "run.mcap"
    flags = ("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets", "use_chunking")
    for _ in range(amount(20, 400, 5000)):
        text = random_definition(rng)
        kind = schema_type("odd/msg/Whole", text)
        assert schema_text(schema_type("odd/msg/Whole", schema_text(kind))) == schema_text(kind)
        messages = [random_message(kind, rng) for _ in range(3)]
        order = EncapsulationKind(int(rng.integers(2)))
        monkeypatch.setattr(dynamic, "CdrWriter", partial(CdrWriter, kind=order))
        options = {flag: bool(rng.integers(2)) for flag in flags}
        indexes = (IndexType.NONE, IndexType.CHUNK, IndexType.ALL)
        content, writer = io.BytesIO(), Writer(io.BytesIO())
        writer._writer = McapWriter(
            content, index_types=indexes[rng.integers(3)], compression=CompressionType.ZSTD, **options
        )
        writer._writer.start(profile="ros2", library="zoo")
        schema = writer.register_msgdef("odd/msg/Whole", text)
        for time, message in enumerate(messages):
            writer.write_message("/odd", schema, values_of(message), log_time=time)
        writer.finish()
        path.write_bytes(content.getvalue())
        read = list(Bag(path).messages())
        assert [values_of(one.message) for one in read] == [values_of(message) for message in messages], text
        with BagWriter(path) as bag:
            for one in read:
                bag.write(one.topic, one.message, one.time)
        theirs = [plain(one.ros_msg) for one in read_ros2_messages(path)]
        assert theirs == [values_of(message) for message in messages], text
        tried("random message types", 1)


def test_lerobot_sets_of_random_features(amount, rng, tried, tmp_path):
    """Columns, lengths and statistics of random sets, recomputed from the Parquet files."""
    for case in range(amount(5, 40, 400)):
        sizes = {f"f.{k}": int(rng.integers(1, 4)) for k in range(rng.integers(1, 4))}
        place = tmp_path / str(case)
        features = {name: Feature(size) for name, size in sizes.items()}
        lengths = rng.integers(1, 9, size=int(rng.integers(1, 6))).tolist()
        written = {name: [] for name in sizes}
        with LeRobotWriter(place, fps=10, features=features, frames_per_file=10) as writer:
            for k, length in enumerate(lengths):
                frames = {n: rng.normal(size=(length, size)).astype(np.float32) for n, size in sizes.items()}
                writer.add(f"task {k % 2}", **frames)
                for name, values in frames.items():
                    written[name].append(values)
        info = json.loads((place / "meta" / "info.json").read_text())
        stats = json.loads((place / "meta" / "stats.json").read_text())
        table = pa.concat_tables([pq.read_table(p) for p in sorted((place / "data").rglob("*.parquet"))])
        assert table["index"].to_pylist() == list(range(sum(lengths)))
        for name, size in sizes.items():
            column, kind = np.concatenate(written[name]), table.schema.field(name).type
            assert info["features"][name]["shape"] == [size]
            assert kind == (pa.float32() if size == 1 else pa.list_(pa.float32(), size))
            assert np.array_equal(np.array(table[name].to_pylist(), np.float32).reshape(-1, size), column)
            np.testing.assert_allclose(stats[name]["mean"], column.mean(axis=0, dtype=float), atol=1e-6)
            np.testing.assert_allclose(stats[name]["std"], column.std(axis=0, dtype=float), atol=1e-6)
            assert stats[name]["count"] == [sum(lengths)]
        episodes = pq.read_table(place / "meta/episodes/chunk-000/file-000.parquet")
        assert episodes["length"].to_pylist() == lengths
        tried("LeRobot sets", 1)
