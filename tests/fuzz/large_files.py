"""Large files for every reader: of many parts, or asking for endless work or memory.

This is no test: `reader_process.py` reads them within its limits.  A size is the most that a file takes [kB].
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from reader_cases import READERS, Reader, with_path
from reader_checks import motion
from reader_files import (
    BEHAVIOR,
    COLLADA,
    PLY,
    PROJECT,
    ROBOT,
    SCENE,
    arrays_of,
    packed,
    reach_arrays,
    recording_files,
    run_file,
    trajectory_file,
)

from pepper_kin.files import load
from pepper_kin.twin.recording_header import HEADER

Build = Callable[[int], bytes]
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
HINGE = f'<joint name="j" type="revolute"><parent link="b"/><child link="m"/>{LIMIT}</joint></robot>'


def filled(head: str, unit: str | Callable[[int], str], tail: str = "") -> Build:
    """Return a text that repeats its middle, given its number, as often as it fits."""

    def build(size: int) -> bytes:
        parts, left, i = [head], 1000 * size - len(head) - len(tail), 0
        while True:
            part = unit if isinstance(unit, str) else unit(i)
            left, i = left - len(part), i + 1
            if left < 0:
                return ("".join(parts) + tail).encode()
            parts.append(part)

    return build


def numbered(count_of: Callable[[int], int], text: Callable[[int], str]) -> Build:
    """Return a text made of a number that is what fits, by the size [bytes]."""
    return lambda size: text(count_of(1000 * size)).encode()


def star(kind: str, inside: str = "") -> Build:
    """Return a robot whose links all hang on one."""
    return filled(
        f'<robot name="r"><link name="b"/><link name="m"/>{HINGE[:-8]}',
        lambda i: (
            f'<link name="l{i}">{inside}</link><joint name="f{i}" type="{kind}"><parent link="b"/>'
            f'<child link="l{i}"/>{LIMIT}</joint>'
        ),
        "</robot>",
    )


def followers(i: int) -> str:
    """Return a link on a joint that follows the one before."""
    leader = f"f{i - 1}" if i else "j"
    return (
        f'<link name="l{i}"/><joint name="f{i}" type="revolute"><parent link="b"/><child link="l{i}"/>{LIMIT}'
        f'<mimic joint="{leader}"/></joint>'
    )


def chain(size: int) -> bytes:
    """Return a long chain of moving links."""
    count = min(2900, 1000 * size // 250)
    links = "".join(
        f'<link name="l{i + 1}">{MASS}</link><joint name="j{i}" type="revolute"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/>{LIMIT}</joint>'
        for i in range(count)
    )
    return f'<robot name="r"><link name="l0"/>{links}</robot>'.encode()


def shapes(element: str, geometry: str) -> Build:
    """Return a robot of many shapes."""
    part = f"<{element}><geometry>{geometry}</geometry></{element}>"
    return filled('<robot name="r"><link name="b"/><link name="m">', part, f"</link>{HINGE}")


def scene(key: str, row: Callable[[int], Any], width: int) -> Build:
    """Return a scene with a list of rows, each of some bytes."""
    return lambda size: json.dumps(
        {**SCENE, "objects": [], "attached": [], "allowed": [], key: [*map(row, range(1000 * size // width))]}
    ).encode()


def one_object(kind: str, values: Callable[[int], dict[str, Any]], width: int) -> Build:
    """Return a scene of one object with many rows, each of some bytes."""

    def build(size: int) -> bytes:
        item = {"name": "o", "kind": kind, **values(1000 * size // width)}
        return json.dumps({**SCENE, "objects": [item], "attached": [], "allowed": []}).encode()

    return build


def on_sphere(count: int) -> list[list[float]]:
    """Return points all of which are corners of their hull."""
    points = np.random.default_rng(0).normal(size=(max(count, 8), 3))
    return np.round(points / np.linalg.norm(points, axis=1)[:, None], 7).tolist()  # type: ignore[no-any-return]


def rows_of(suffix: str) -> Build:
    """Return a CSV file of many rows of zeros."""
    header = trajectory_file(suffix).decode().splitlines()[0]
    return filled(header + "\n", lambda i: f"{0.01 * i:.2f}" + ",0" * header.count(",") + "\n")


def wide(count: int, rows: int = 1) -> str:
    """Return a CSV file of many columns."""
    kinds = ("position", "velocity", "acceleration")
    names = ["time", *(f"j{i}.{kind}" for kind in kinds for i in range(count))]
    return ",".join(names) + "\n" + "".join(f"{i}" + ",0" * 3 * count + "\n" for i in range(rows))


def runs(size: int) -> bytes:
    """Return a run of many rows."""
    header, row = run_file().decode().splitlines()[:2]
    rest = row.partition(",")[2]
    return filled(header + "\n", lambda i: f"{0.1 * i:.1f},{rest}\n")(size)


def long_json(size: int) -> bytes:
    """Return a trajectory of many segments."""
    content = json.loads(trajectory_file(".json"))
    count = 1000 * size // 250
    segment = np.zeros_like(content["coefficients"][0]).tolist()
    content["breaks"], content["coefficients"] = list(range(count + 1)), [segment] * count
    return json.dumps(content).encode()


def long_archive(size: int) -> bytes:
    """Return a trajectory whose zeros take 1000 times more than its file."""
    arrays = arrays_of(trajectory_file(".npz"))
    count = 200 * size
    arrays["breaks"] = np.arange(count + 1.0)
    arrays["coefficients"] = np.zeros((count, *arrays["coefficients"].shape[1:]))
    return packed(arrays)


def members(size: int) -> bytes:
    """Return a zip of many empty members."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for i in range(1000 * size // 100):
            archive.writestr(f"a{i}.npy", b"")
    return content.getvalue()


def grid(size: int) -> bytes:
    """Return a reach map of many voxels."""
    edge = round((1000.0 * size * 3) ** (1 / 3))
    counts, best = np.ones((edge,) * 3, np.int64), np.ones((edge,) * 3, np.float32)
    return packed({**reach_arrays(), "counts": counts, "best": best})


def header(size: int) -> bytes:
    """Return the header of a recording with a long list."""
    content = json.loads(recording_files()[HEADER])
    return json.dumps({**content, "x": [0] * (300 * size)}).encode()


def yaml(row: Callable[[int], str], names: str = "elbow, rail, roll") -> Build:
    """Return a JointTrajectory of many points."""
    return filled(f"joint_names: [{names}]\npoints:\n", row)


def aliases(size: int) -> bytes:
    """Return points that repeat the first one's many positions by its name."""
    count = 500 * size // 10
    names, zeros = ",".join(f"j{i}" for i in range(count)), ",".join("0" * count)
    first = f"- {{positions: &a [{zeros}], time_from_start: {{sec: 0, nanosec: 0}}}}\n"
    row = "- {{positions: *a, time_from_start: {{sec: {0}, nanosec: 0}}}}\n"
    return filled(f"joint_names: [{names}]\npoints:\n{first}", lambda i: row.format(i + 1))(size)


def keys(size: int) -> bytes:
    """Return Choregraphe's export of many keys."""
    count = 1000 * size // 14
    times, angles = ",".join(f"{0.04 * i:.2f}" for i in range(1, count)), ",".join(["0.1"] * (count - 1))
    lists = {"names": '"HeadYaw"', "times": f"[{times}]", "keys": f"[{angles}]"}
    return "".join(f"{name} = list()\n{name}.append({value})\n" for name, value in lists.items()).encode()


def behavior(count_of: int, inside: Callable[[int], str], before: str) -> Build:
    """Return a behavior with many parts before one of its own, each of some bytes."""
    return lambda size: BEHAVIOR.replace(
        before, "".join(map(inside, range(1000 * size // count_of))) + before, 1
    ).encode()


def triangles(size: int) -> bytes:
    """Return a binary STL file of random triangles."""
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    found = np.zeros(20 * size - 2, kind)
    found["corners"] = np.random.default_rng(0).random((len(found), 3, 3))
    return bytes(80) + len(found).to_bytes(4, "little") + found.tobytes()


def ply(size: int) -> bytes:
    """Return a PLY file of many triangles."""
    count = (1000 * size - 300) // 8
    head = PLY.replace("element face 1", f"element face {count}").removesuffix("3 0 1 2\n")
    return (head + "3 0 1 2\n" * count).encode()


def gltf(nodes: list[dict[str, Any]], roots: list[int], count: int = 3, view: bool = True) -> bytes:
    """Return a glTF file of nodes that show one mesh."""
    accessor = {"componentType": 5126, "count": count, "type": "VEC3", **({"bufferView": 0} if view else {})}
    content = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [accessor],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}],
    }  # fmt: skip
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    data = (36).to_bytes(4, "little") + b"BIN\0" + bytes(36)
    body = len(text).to_bytes(4, "little") + b"JSON" + text + data
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body


def mcap(kind: str, definition: str, data: bytes, messages: int, topics: int = 1) -> bytes:
    """Return a recording in which a message is repeated."""
    from mcap.writer import Writer

    content = io.BytesIO()
    writer = Writer(content)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema(kind, "ros2msg", definition.encode())
    channels = [writer.register_channel(f"/t{i}", "cdr", schema) for i in range(topics)]
    for i in range(messages):
        writer.add_message(channels[i % topics], log_time=i, data=data, publish_time=i)
    writer.finish()
    return content.getvalue()


FLOAT = ("std_msgs/msg/Float64", "float64 data", b"\0\1\0\0" + bytes(8))
STATE = ("sensor_msgs/msg/JointState", "string[] name\nfloat64[] position", b"\0\1\0\0" + bytes(1_000_000))
DEFINITION = ("a_msgs/msg/T", b"\0\1\0\0" + bytes(80))


def doubling(tag: Callable[[int], str]) -> str:
    """Return thirty parts each of which holds the one before twice."""
    return "".join(map(tag, range(1, 31)))


def twice(i: int) -> str:
    """Return a node of COLLADA that shows the one before twice."""
    below = f'<instance_node url="#n{i - 1}"/>' if i > 1 else '<instance_geometry url="#shape"/>'
    return f'<node id="n{i}">{2 * below}</node>'


KEY = '<Key frame="11" value="3"/>'
ACTUATOR = f'<ActuatorCurve name="value" actuator="A{{0}}" mute="0" unit="0">{KEY}</ActuatorCurve>'
TIMELINE = '<Timeline enable="1" fps="25" start_frame="1" end_frame="-1" size="60"><ActuatorList model="">'
BOX = f'<Box name="B{{0}}" id="{{0}}">{TIMELINE}{ACTUATOR}</ActuatorList></Timeline></Box>'
DESCRIPTION = '<BehaviorDescription name="b{0}" src="." xar="behavior.xar"/>'
EXPORT_ROW = 'names.append("J{0}")\ntimes.append([1])\nkeys.append([0])\n'
DUPLICATE = '"name": "o", "kind": "sphere", "radius": 1, '

FILES: dict[str, tuple[str, bool, Build]] = {
    "fixed joints": ("URDF", True, star("fixed")),
    "moving joints": ("URDF", True, star("revolute")),
    "joints with masses": ("URDF", True, star("continuous", MASS)),
    "a chain": ("URDF", True, chain),
    "joints that follow": (
        "URDF",
        True,
        filled(f'<robot name="r"><link name="b"/><link name="m"/>{HINGE[:-8]}', followers, "</robot>"),
    ),
    "boxes": ("URDF", True, shapes("visual", '<box size="1 1 1"/>')),
    "spheres": ("URDF", True, shapes("collision", '<sphere radius="1"/>')),
    "meshes": ("URDF", True, shapes("visual", '<mesh filename="part.stl"/>')),
    "meshes that collide": ("URDF", True, shapes("collision", '<mesh filename="part.stl"/>')),
    "materials": (
        "URDF",
        True,
        filled(
            '<robot name="r"><link name="b"/><link name="m"/>',
            lambda i: f'<material name="m{i}"><color rgba="1 1 1 1"/></material>',
            HINGE,
        ),
    ),
    "a long name": (
        "URDF",
        False,
        filled('<robot name="r"><link name="b"/><link name="m"/><link name="', "m", f'"/>{HINGE}'),
    ),
    "attributes": (
        "URDF",
        False,
        filled('<robot name="r"><link name="m"/><link name="b" ', lambda i: f'a{i}="" ', f"/>{HINGE}"),
    ),
    "numbers in one place": (
        "URDF",
        False,
        lambda size: ROBOT.replace("0 0 0.1", "0 " * (400 * size), 1).encode(),
    ),
    "roots": (
        "URDF",
        False,
        filled('<robot name="r"><link name="b"/><link name="m"/>', lambda i: f'<link name="l{i}"/>', HINGE),
    ),
    "entities": ("URDF", False, filled('<!DOCTYPE r [<!ENTITY a "xxxxxxxxxx">]><robot name="', "&a;", '"/>')),
    "a chain on a base": ("URDF on a base", True, chain),
    "joints on a base": ("URDF on a base", True, star("revolute")),
    "joints": ("audit", True, star("continuous", MASS)),
    "a long chain": ("audit", True, chain),
    "colliding spheres": ("audit", True, shapes("collision", '<sphere radius="1"/>')),
    "other joints": ("compare", True, star("continuous", MASS)),
    "groups of groups": (
        "SRDF",
        True,
        filled(
            '<robot name="sample"><group name="arm"><joint name="elbow"/></group>',
            lambda i: f'<group name="g{i}"><group name="{f"g{i - 1}" if i else "arm"}"/></group>',
            "</robot>",
        ),
    ),
    "groups": (
        "SRDF",
        True,
        filled(
            '<robot name="sample"><group name="arm"><joint name="elbow"/></group>',
            lambda i: f'<group name="g{i}"><group name="arm"/></group>',
            "</robot>",
        ),
    ),
    "chains in a group": (
        "SRDF",
        True,
        filled(
            '<robot name="sample"><group name="arm">',
            '<chain base_link="base" tip_link="tip"/>',
            "</group></robot>",
        ),
    ),
    "states": (
        "SRDF",
        True,
        filled(
            '<robot name="sample"><group name="arm"><joint name="elbow"/></group>',
            lambda i: f'<group_state name="s{i}" group="arm"><joint name="elbow" value="0"/></group_state>',
            "</robot>",
        ),
    ),
    "pairs": (
        "SRDF",
        True,
        filled('<robot name="sample">', '<disable_collisions link1="base" link2="arm"/>', "</robot>"),
    ),
    "objects": (
        "scene",
        True,
        scene("objects", lambda i: {"name": f"o{i}", "kind": "box", "size": [1, 1, 1]}, 60),
    ),
    "hulls": (
        "scene",
        True,
        scene(
            "objects",
            lambda i: {
                "name": f"o{i}",
                "kind": "convex mesh",
                "vertices": np.eye(4)[:, :3].astype(int).tolist(),
            },
            125,
        ),
    ),
    "hull of a ball": ("scene", True, one_object("convex mesh", lambda n: {"vertices": on_sphere(n)}, 38)),
    "points": (
        "scene",
        True,
        one_object(
            "point cloud",
            lambda n: {"points": np.random.default_rng(0).random((n, 3)).round(5).tolist(), "radius": 0.01},
            32,
        ),
    ),
    "one triangle again and again": (
        "scene",
        True,
        one_object(
            "triangle mesh",
            lambda n: {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]] * n},
            11,
        ),
    ),
    "attached objects": (
        "scene",
        True,
        scene(
            "attached", lambda i: {"name": f"o{i}", "kind": "sphere", "radius": 0.1, "frame": "l_gripper"}, 80
        ),
    ),
    "a field twice": ("scene", False, filled("{", lambda i: f'"a{i}": 0, ', '"z": 0, "z": 0}')),
    "brackets": ("scene", False, filled("", "[")),
    "digits": ("scene", False, filled("", "1")),
    "rows": ("CSV", True, rows_of(".csv")),
    "columns": ("CSV", True, lambda size: wide(1000 * size // 90, 2).encode()),
    "columns and rows": ("CSV", False, lambda size: (wide(500 * size // 45) + "1\n" * (250 * size)).encode()),
    "a column twice": (
        "CSV",
        False,
        filled("time,", lambda i: f"j{i}.position,", "z.position,z.position\n0\n"),
    ),
    "commas": ("CSV", False, filled("", ",")),
    "lines": ("CSV", False, filled("", "\n")),
    "quotes": ("CSV", False, filled("", '"')),
    "rows of a table": ("table", True, rows_of(".csv")),
    "columns of a table": ("table", True, lambda size: wide(1000 * size // 60).encode()),
    "rows of states": ("joint states CSV", True, rows_of(".csv")),
    "segments": ("JSON", True, long_json),
    "zeros": ("NPZ", True, long_archive),
    "members": ("NPZ", False, members),
    "points in YAML": (
        "ROS YAML",
        True,
        yaml(lambda i: f"- {{positions: [0.0, 0.1, 0.0], time_from_start: {{sec: {i}, nanosec: 0}}}}\n"),
    ),
    "names in YAML": ("ROS YAML", False, filled("joint_names: [", "a, ", "a]\n")),
    "aliases": ("ROS YAML", True, aliases),
    "brackets in YAML": ("ROS YAML", False, filled("", "[", "\n")),
    "dashes": ("ROS YAML", False, filled("", "- ", "\n")),
    "a list in a script": (
        "NAOqi script",
        True,
        filled(trajectory_file(".py").decode() + "x = [", "0,", "]\n"),
    ),
    "a sum": ("NAOqi script", False, filled("x = 1", "+1", "\n")),
    "statements": ("NAOqi script", False, filled("", "x=1\n")),
    "parentheses": ("NAOqi script", False, filled("", "(")),
    "signs": ("NAOqi script", False, filled("x = ", "-", "1\n")),
    "messages without data": ("MCAP", False, lambda size: mcap(*STATE, messages=size * 2 // 3)),
    "states without data": ("joint states MCAP", False, lambda size: mcap(*STATE, messages=size * 2 // 3)),
    "empty messages": ("bag", True, lambda size: mcap(*STATE, messages=size * 2 // 3)),
    "messages": ("bag", True, lambda size: mcap(*FLOAT, messages=1000 * size // 20)),
    "topics": (
        "bag",
        True,
        lambda size: mcap(*FLOAT, messages=1000 * size // 100, topics=1000 * size // 100),
    ),
    "a long definition": (
        "bag",
        False,
        lambda size: mcap(DEFINITION[0], "float64 x\n" * (100 * size), DEFINITION[1], 1),
    ),
    "keys": ("Choregraphe export", True, keys),
    "curves of an export": ("Choregraphe export", True, filled("", lambda i: EXPORT_ROW.format(i))),
    "curves": ("Choregraphe behavior", True, behavior(110, ACTUATOR.format, "<ActuatorCurve")),
    "timelines": ("Choregraphe behavior", True, behavior(270, BOX.format, '<Box name="Hello"')),
    "behaviors": (
        "Choregraphe project",
        True,
        lambda size: PROJECT.replace(
            "<BehaviorDescriptions>",
            "<BehaviorDescriptions>" + "".join(map(DESCRIPTION.format, range(1000 * size // 63))),
        ).encode(),
    ),
    "rows of a run": ("run", True, runs),
    "rows of a motion": ("motion", True, runs),
    "a list in a header": ("recording header", False, header),
    "brackets in a header": ("recording header", False, filled("", "[")),
    "members of a chunk": ("recording", False, members),
    "voxels": ("reach map", True, grid),
    "members of a map": ("reach map", False, members),
    "triangles": ("STL", True, triangles),
    "triangles of a head": ("Pepper's meshes", True, triangles),
    "triangles that are shown": ("audit of meshes", True, triangles),
    "facets": (
        "STL text",
        True,
        filled(
            "solid part\n",
            "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n",
            "endsolid part\n",
        ),
    ),
    "spaces": ("STL text", False, filled("solid ", " ")),
    "a polygon": ("OBJ", True, filled("v 0 0 0\nv 1 0 0\nv 0 1 0\nf", " 1 2 3", "\n")),
    "groups of faces": ("OBJ", True, filled("v 0 0 0\nv 1 0 0\nv 0 1 0\n", lambda i: f"g a{i}\nf 1 2 3\n")),
    "slashes": ("OBJ", False, filled("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1", "/")),
    "faces": ("PLY", True, ply),
    "3 billion vertices": ("PLY", False, lambda _: PLY.replace("vertex 3", "vertex 3000000000").encode()),
    "properties": (
        "PLY",
        False,
        filled(
            "ply\nformat ascii 1.0\nelement vertex 3\n", lambda i: f"property float p{i}\n", "end_header\n"
        ),
    ),
    "the same shape": (
        "COLLADA",
        True,
        lambda size: COLLADA.replace(
            '<instance_geometry url="#shape"/></node></visual',
            '<instance_geometry url="#shape"/>' * (30 * size - 100) + "</node></visual",
        ).encode(),
    ),
    "nodes twice in one another": (
        "COLLADA",
        False,
        lambda _: (
            COLLADA.replace("<library_nodes>", "<library_nodes>" + doubling(twice))
            .replace("#part", "#n30")
            .encode()
        ),
    ),
    "indices": (
        "COLLADA",
        True,
        lambda size: (
            COLLADA.replace('count="2"', f'count="{150 * size}"')
            .replace("0 2 1 0 1 3", "0 1 2 " * (150 * size))
            .encode()
        ),
    ),
    "nodes in one another": (
        "glTF",
        False,
        lambda size: gltf([{"children": [i + 1]} for i in range(1000 * size // 25)] + [{"mesh": 0}], [0]),
    ),
    "billion of vertices": ("glTF", False, lambda _: gltf([{"mesh": 0}], [0], 1_000_000_000, view=False)),
    "nodes": (
        "glTF",
        False,
        lambda size: gltf([{"mesh": 0}] * (1000 * size // 20), [*range(1000 * size // 20)]),
    ),
    "names of columns": (
        "columns",
        True,
        lambda size: json.dumps(
            {
                f"c{i}": {"unit": "m", "quantity": "position", "joint": f"j{i}"}
                for i in range(1000 * size // 70)
            }
        ).encode(),
    ),
}
"""Name -> how it is read, whether a small one of the kind is read, and what makes it."""


def reader_of(file: str) -> Reader:
    """Return the reader of "name, size kB"; its file is not damaged."""
    name, _, size_text = file.rpartition(", ")
    size = int(size_text.split()[0])
    kind, _, build = FILES[name]
    reader = replace(READERS[kind], damage=lambda _: build(size))
    if kind in ("CSV", "JSON", "NPZ", "ROS YAML", "NAOqi script", "MCAP"):
        reader = replace(reader, read=with_path(load, motion))  # once, without a robot
    return reader
