"""How the files of readers are damaged: texts, XML, JSON, archives and recordings."""

from __future__ import annotations

import io
import json
import math
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from mutations import (
    Rng,
    changed_arrays,
    changed_bytes,
    changed_json,
    changed_text,
    changed_xml,
    encoded,
    pick,
)
from reader_files import arrays_of, packed, recording_files, trajectory_file

from pepper_kin.twin.recording_header import HEADER


def text_damage(*texts: str) -> Callable[[Rng], bytes]:
    """Return damage of lines, words, numbers and bytes."""
    whole = tuple(encoded(text) for text in texts)

    def damage(rng: Rng) -> bytes:
        text = str(pick(rng, texts))
        if rng.random() < 0.25:
            return changed_bytes(encoded(text), rng, whole)
        for _ in range(1 if rng.random() < 0.7 else 3):
            text = changed_text(text, rng)
        return coded(text, rng)

    return damage


def coded(text: str, rng: Rng) -> bytes:
    """Return a text as bytes, now and then in an encoding that nobody expects."""
    if rng.random() < 0.03:
        return text.encode(str(pick(rng, ("utf-16", "utf-8-sig", "latin-1", "utf-32"))), "replace")
    return encoded(text)


def xml_damage(*texts: str) -> Callable[[Rng], bytes]:
    """Return damage of elements and of texts."""
    of_text = text_damage(*texts)

    def damage(rng: Rng) -> bytes:
        return coded(changed_xml(str(pick(rng, texts)), rng), rng) if rng.random() < 0.6 else of_text(rng)

    return damage


def json_damage(content: Callable[[], Any]) -> Callable[[Rng], bytes]:
    """Return damage of parts and of texts."""

    def damage(rng: Rng) -> bytes:
        if rng.random() < 0.6:
            return coded(changed_json(content(), rng), rng)
        return text_damage(json.dumps(content(), indent=1))(rng)

    return damage


def archive_damage(content: Callable[[], bytes]) -> Callable[[Rng], bytes]:
    """Return damage of arrays and of bytes."""

    def damage(rng: Rng) -> bytes:
        if rng.random() < 0.4:
            return changed_bytes(content(), rng)
        arrays = arrays_of(content())
        for _ in range(1 if rng.random() < 0.8 else 3):
            arrays = changed_arrays(arrays, rng) or {"x": np.zeros(1)}
        if rng.random() < 0.05:
            return claimed_shape(arrays, rng)
        return packed(arrays)

    return damage


def claimed_shape(arrays: dict[str, Any], rng: Rng) -> bytes:
    """Return an archive one of whose arrays says that it is far larger than it is."""
    import zipfile

    content, chosen = io.BytesIO(), str(pick(rng, sorted(arrays)))
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array, allow_pickle=False)
            data = member.getvalue()
            if name == chosen:
                shape = pick(
                    rng, ("(100000000000,)", "(-1,)", "(2, 10000000)", "(99999999999999999999,)", "('a',)")
                )
                head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
                data = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + bytes(64)
            archive.writestr(f"{name}.npy", data)
    return content.getvalue()


def mcap_damage(rng: Rng) -> bytes:
    """Return a recording with damaged bytes, or whole with odd messages."""
    if rng.random() < 0.4:
        return changed_bytes(trajectory_file(".mcap"), rng)
    from mcap_ros2.writer import Writer

    from pepper_kin.ros_messages import message_type
    from pepper_kin.ros_messages.schemas import schema_text

    content = io.BytesIO()
    writer = Writer(content)
    schema, whole = (
        writer.register_msgdef(name, schema_text(message_type(name)))
        for name in ("sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory")
    )
    names = ["elbow", "rail", "roll"]
    odd = (math.nan, math.inf, -1.0, 1e308, 1e-320, 0.5)
    stamps = [0, 10**9, 2 * 10**9]
    if rng.random() < 0.3:
        stamps[int(rng.integers(3))] = int(pick(rng, (-1, 0, 10**9, 2**62, -(10**18))))
    if rng.random() < 0.3:
        names[int(rng.integers(3))] = str(pick(rng, ("", "elbow", "x" * 10_000, "a/b", "\u732b")))
    rows = np.full((3, 3), 0.25)
    if rng.random() < 0.5:
        rows[tuple(rng.integers(0, 3, 2))] = pick(rng, odd)
    points = []
    for i, stamp in enumerate(stamps):
        position = rows[i].tolist()[: 3 if rng.random() < 0.9 else int(rng.integers(4))]
        seconds, nanoseconds = divmod(stamp, 10**9)
        time = {"sec": max(min(seconds, 2**31 - 1), -(2**31)), "nanosec": nanoseconds}
        header = {"stamp": time, "frame_id": ""}
        message = {"header": header, "name": names, "position": position, "velocity": [], "effort": []}
        topic = "/joint_states" if rng.random() < 0.95 else "/other"
        writer.write_message(topic, schema, message, log_time=max(stamp, 0), sequence=i)
        extra = [float(pick(rng, odd))] * int(rng.integers(4)) if rng.random() < 0.2 else []
        points.append(
            {
                "positions": position,
                "velocities": extra,
                "accelerations": [],
                "effort": [],
                "time_from_start": time,
            }
        )
    head = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    writer.write_message("/joint_trajectory", whole, {"header": head, "joint_names": names, "points": points})
    writer.finish()
    found = content.getvalue()
    return changed_bytes(found, rng) if rng.random() < 0.1 else found


def bag_damage(rng: Rng) -> bytes:
    """Return a recording of one message whose bytes, definition or both are damaged."""
    from mcap.writer import Writer

    from pepper_kin.ros_messages import encode, message_type
    from pepper_kin.ros_messages.schemas import schema_text

    kind = message_type("trajectory_msgs/msg/JointTrajectory")
    message = kind(joint_names=["elbow", "rail"], points=[kind.nested["points"](positions=[0.1, 0.2])])
    text, data = schema_text(kind).encode(), encode(message)
    damaged = rng.random()
    if damaged < 0.7:
        text = changed_bytes(text, rng)
    if damaged > 0.4:
        data = changed_bytes(data, rng)
    content = io.BytesIO()
    writer = Writer(content)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema(kind.type_name, "ros2msg", text)
    channel = writer.register_channel("/joint_trajectory", "cdr", schema)
    writer.add_message(channel, log_time=0, data=data, publish_time=0)
    writer.finish()
    found = content.getvalue()
    return changed_bytes(found, rng) if rng.random() < 0.1 else found


def header_damage(rng: Rng) -> bytes:
    """Return a header that is damaged, mostly with the checksum that belongs to it."""
    header = json.loads(recording_files()[HEADER])
    if rng.random() < 0.3:
        return text_damage(json.dumps(header, indent=1))(rng)
    checksum = header.pop("checksum")
    text = changed_json(header, rng)
    try:
        changed = json.loads(text)
        if isinstance(changed, dict):
            right = zlib.crc32(json.dumps(changed, sort_keys=True).encode())
            changed["checksum"] = right if rng.random() < 0.9 else checksum
        return encoded(json.dumps(changed, indent=1, ensure_ascii=bool(rng.random() < 0.9)))
    except (ValueError, TypeError):
        return encoded(text)


def chunk() -> bytes:
    """Return a chunk of a recording."""
    return recording_files()["000000.npz"]


def chunk_damage(rng: Rng) -> bytes:
    """Return a chunk with damaged arrays, among them what is packed in them."""
    if rng.random() < 0.5:
        return archive_damage(chunk)(rng)
    arrays = arrays_of(chunk())
    names = [name for name in sorted(arrays) if arrays[name].dtype == np.uint8 and arrays[name].size]
    name = str(pick(rng, names))
    arrays[name] = np.frombuffer(_repacked(arrays[name].tobytes(), rng), np.uint8)
    return packed(arrays)


def _repacked(data: bytes, rng: Rng) -> bytes:
    """Damage a packed series in front of, or within, what is compressed."""
    start = data.find(b"\x78\x9c")
    if start < 0 or rng.random() < 0.4:
        return changed_bytes(data, rng)
    body = bytes(60_000_000) if rng.random() < 0.03 else changed_bytes(zlib.decompress(data[start:]), rng)
    return data[:start] + zlib.compress(body)
