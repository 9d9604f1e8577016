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
import pyarrow as pa
import pyarrow.parquet as pq
from reader_cases import READERS, Reader, with_path
from reader_checks import motion
from reader_files import (
    BEHAVIOR,
    COLLADA,
    DATASET_JOB,
    PLY,
    POINTS,
    PROJECT,
    ROBOT,
    SCENE,
    arrays_of,
    packed,
    point_arrays,
    policy_arrays,
    reach_arrays,
    recording_files,
    run_file,
    sample,
    trajectory_file,
)

from pepper_kin.files import load
from pepper_kin.twin.recording_header import HEADER

Build = Callable[[int], bytes]
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
HINGE = f'<joint name="j" type="revolute"><parent link="b"/><child link="m"/>{LIMIT}</joint></robot>'


def scene_of_job(size: int) -> bytes:
    """Return a job with a scene of many points."""
    head = DATASET_JOB + "scenes:\n  - objects:\n      - {name: a, kind: point cloud, radius: 0.01, points: ["
    return filled(head, "[1.0, 1.0, 9.0], ", "]}\n")(size)


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


def long_parquet(size: int) -> bytes:
    """Return a motion whose columns of zeros take hundreds of times more than its file."""
    names = [f"{joint}.{kind}" for kind in ("position", "velocity") for joint in sample().joint_names]
    count = 200 * size
    return parquet({"time": np.arange(float(count)), **{name: np.zeros(count) for name in names}})


def wide_parquet(size: int) -> bytes:
    """Return a motion of many joints."""
    names = [f"j{k}.{kind}" for kind in ("position", "velocity") for k in range(2 * size // 3)]
    return parquet({"time": np.arange(2.0), **{name: np.zeros(2) for name in names}})


def parquet(columns: dict[str, Any]) -> bytes:
    """Return columns as a file of Parquet."""
    content = io.BytesIO()
    pq.write_table(pa.table(columns), content, compression="zstd")
    return content.getvalue()


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


def layer(size: int) -> bytes:
    """Return a policy with a long layer of numbers that do not shrink."""
    hidden = 1000 * size // 28
    drawn = np.random.default_rng(0).normal(0.0, 1e-3, (4, hidden)).astype(np.float32)
    return packed({**policy_arrays(hidden), "weight_0": drawn})


def frames(size: int) -> bytes:
    """Return key points over many frames."""
    count = 1000 * size // 60
    points = np.random.default_rng(0).random((count, 2, 3))
    return packed({**point_arrays(count), "points": points})


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

TWO_LINKS = '<robot name="r"><link name="b"/><link name="m"/>'
ARM = '<robot name="sample"><group name="arm"><joint name="elbow"/></group>'
STATE_OF_GROUP = '<group_state name="s{0}" group="arm"><joint name="elbow" value="0"/></group_state>'
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
POINT = "- {{positions: [0.0, 0.1, 0.0], time_from_start: {{sec: {0}, nanosec: 0}}}}\n"
PLY_HEAD = "ply\nformat ascii 1.0\nelement vertex 3\n"


def nested_group(i: int) -> str:
    """Return a group that holds the one before."""
    return f'<group name="g{i}"><group name="{f"g{i - 1}" if i else "arm"}"/></group>'


def box(i: int) -> dict[str, Any]:
    """Return an object of a scene."""
    return {"name": f"o{i}", "kind": "box", "size": [1, 1, 1]}


def hull(i: int) -> dict[str, Any]:
    """Return a tetrahedron of a scene."""
    return {"name": f"o{i}", "kind": "convex mesh", "vertices": np.eye(4)[:, :3].astype(int).tolist()}


def hung(i: int) -> dict[str, Any]:
    """Return an attached object of a scene."""
    return {"name": f"o{i}", "kind": "sphere", "radius": 0.1, "frame": "l_gripper"}


def cloud(count: int) -> dict[str, Any]:
    """Return the values of a cloud of points."""
    return {"points": np.random.default_rng(0).random((count, 3)).round(5).tolist(), "radius": 0.01}


def one_triangle(count: int) -> dict[str, Any]:
    """Return the values of a mesh whose one triangle is repeated."""
    return {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]] * count}


def behaviors(size: int) -> bytes:
    """Return a project of many behaviors."""
    descriptions = "".join(map(DESCRIPTION.format, range(1000 * size // 63)))
    return PROJECT.replace("<BehaviorDescriptions>", "<BehaviorDescriptions>" + descriptions).encode()


def same_shape(size: int) -> bytes:
    """Return a scene of COLLADA that shows one shape again and again."""
    shape = '<instance_geometry url="#shape"/>'
    return COLLADA.replace(f"{shape}</node></visual", shape * (30 * size - 100) + "</node></visual").encode()


def nodes_twice(_: int) -> bytes:
    """Return nodes of COLLADA each of which shows the one before twice."""
    inside = "<library_nodes>" + doubling(twice)
    return COLLADA.replace("<library_nodes>", inside).replace("#part", "#n30").encode()


def indices(size: int) -> bytes:
    """Return a mesh of COLLADA of many triangles."""
    more = COLLADA.replace('count="2"', f'count="{150 * size}"')
    return more.replace("0 2 1 0 1 3", "0 1 2 " * (150 * size)).encode()


def columns(size: int) -> bytes:
    """Return the description of many columns."""
    row = {"unit": "m", "quantity": "position"}
    return json.dumps({f"c{i}": {**row, "joint": f"j{i}"} for i in range(1000 * size // 70)}).encode()


FILES: dict[str, dict[str, Build]] = {
    "URDF": {
        "fixed joints": star("fixed"),
        "moving joints": star("revolute"),
        "joints with masses": star("continuous", MASS),
        "a chain": chain,
        "joints that follow": filled(TWO_LINKS + HINGE[:-8], followers, "</robot>"),
        "boxes": shapes("visual", '<box size="1 1 1"/>'),
        "spheres": shapes("collision", '<sphere radius="1"/>'),
        "meshes": shapes("visual", '<mesh filename="part.stl"/>'),
        "meshes that collide": shapes("collision", '<mesh filename="part.stl"/>'),
        "materials": filled(
            TWO_LINKS, '<material name="m{0}"><color rgba="1 1 1 1"/></material>'.format, HINGE
        ),
        "a long name": filled(TWO_LINKS + '<link name="', "m", f'"/>{HINGE}'),
        "attributes": filled(
            '<robot name="r"><link name="m"/><link name="b" ', 'a{0}="" '.format, f"/>{HINGE}"
        ),
        "numbers in one place": lambda size: ROBOT.replace("0 0 0.1", "0 " * (400 * size), 1).encode(),
        "roots": filled(TWO_LINKS, '<link name="l{0}"/>'.format, HINGE),
        "entities": filled('<!DOCTYPE r [<!ENTITY a "xxxxxxxxxx">]><robot name="', "&a;", '"/>'),
    },
    "URDF on a base": {"a chain on a base": chain, "joints on a base": star("revolute")},
    "audit": {
        "joints": star("continuous", MASS),
        "a long chain": chain,
        "colliding spheres": shapes("collision", '<sphere radius="1"/>'),
    },
    "compare": {"other joints": star("continuous", MASS)},
    "SRDF": {
        "groups of groups": filled(ARM, nested_group, "</robot>"),
        "groups": filled(ARM, '<group name="g{0}"><group name="arm"/></group>'.format, "</robot>"),
        "chains in a group": filled(
            '<robot name="sample"><group name="arm">',
            '<chain base_link="base" tip_link="tip"/>',
            "</group></robot>",
        ),
        "states": filled(ARM, STATE_OF_GROUP.format, "</robot>"),
        "pairs": filled(
            '<robot name="sample">', '<disable_collisions link1="base" link2="arm"/>', "</robot>"
        ),
    },
    "scene": {
        "objects": scene("objects", box, 60),
        "hulls": scene("objects", hull, 125),
        "hull of a ball": one_object("convex mesh", lambda n: {"vertices": on_sphere(n)}, 38),
        "points": one_object("point cloud", cloud, 32),
        "one triangle again and again": one_object("triangle mesh", one_triangle, 11),
        "attached objects": scene("attached", hung, 80),
        "a field twice": filled("{", '"a{0}": 0, '.format, '"z": 0, "z": 0}'),
        "brackets": filled("", "["),
        "digits": filled("", "1"),
    },
    "CSV": {
        "rows": rows_of(".csv"),
        "columns": lambda size: wide(1000 * size // 90, 2).encode(),
        "columns and rows": lambda size: (wide(500 * size // 45) + "1\n" * (250 * size)).encode(),
        "a column twice": filled("time,", "j{0}.position,".format, "z.position,z.position\n0\n"),
        "commas": filled("", ","),
        "lines": filled("", "\n"),
        "quotes": filled("", '"'),
    },
    "table": {
        "rows of a table": rows_of(".csv"),
        "columns of a table": lambda size: wide(1000 * size // 60).encode(),
    },
    "robot's log": {
        "rows of a log": filled("time,A_command,A_measured\n", lambda i: f"{2 + 0.2 * i:.1f},0.1,0.1\n")
    },
    "joint states CSV": {"rows of states": rows_of(".csv")},
    "Parquet": {"rows of zeros": long_parquet, "columns of Parquet": wide_parquet},
    "JSON": {"segments": long_json},
    "NPZ": {"zeros": long_archive, "members": members},
    "ROS YAML": {
        "points in YAML": yaml(POINT.format),
        "names in YAML": filled("joint_names: [", "a, ", "a]\n"),
        "aliases": aliases,
        "brackets in YAML": filled("", "[", "\n"),
        "dashes": filled("", "- ", "\n"),
    },
    "NAOqi script": {
        "a list in a script": filled(trajectory_file(".py").decode() + "x = [", "0,", "]\n"),
        "a sum": filled("x = 1", "+1", "\n"),
        "statements": filled("", "x=1\n"),
        "parentheses": filled("", "("),
        "signs": filled("x = ", "-", "1\n"),
    },
    "MCAP": {"messages without data": lambda size: mcap(*STATE, messages=size * 2 // 3)},
    "joint states MCAP": {"states without data": lambda size: mcap(*STATE, messages=size * 2 // 3)},
    "bag": {
        "empty messages": lambda size: mcap(*STATE, messages=size * 2 // 3),
        "messages": lambda size: mcap(*FLOAT, messages=50 * size),
        "topics": lambda size: mcap(*FLOAT, messages=10 * size, topics=10 * size),
        "a long definition": lambda size: mcap(DEFINITION[0], "float64 x\n" * (100 * size), DEFINITION[1], 1),
    },
    "Choregraphe export": {"keys": keys, "curves of an export": filled("", EXPORT_ROW.format)},
    "Choregraphe behavior": {
        "curves": behavior(110, ACTUATOR.format, "<ActuatorCurve"),
        "timelines": behavior(270, BOX.format, '<Box name="Hello"'),
    },
    "Choregraphe project": {"behaviors": behaviors},
    "run": {"rows of a run": runs},
    "motion": {"rows of a motion": runs},
    "recording header": {"a list in a header": header, "brackets in a header": filled("", "[")},
    "recording": {"members of a chunk": members},
    "reach map": {"voxels": grid, "members of a map": members},
    "dataset job": {"points of a job": scene_of_job, "brackets of a job": filled("", "[")},
    "policy": {"weights": layer, "members of a policy": members},
    "key points": {"frames": frames, "members of key points": members},
    "key points CSV": {"rows of points": filled(POINTS, lambda i: f"{i + 1},1,2,3\n")},
    "STL": {"triangles": triangles},
    "Pepper's meshes": {"triangles of a head": triangles},
    "audit of meshes": {"triangles that are shown": triangles},
    "STL text": {"facets": filled("solid part\n", FACET, "endsolid part\n"), "spaces": filled("solid ", " ")},
    "OBJ": {
        "a polygon": filled(f"{CORNERS}f", " 1 2 3", "\n"),
        "groups of faces": filled(CORNERS, "g a{0}\nf 1 2 3\n".format),
        "slashes": filled(f"{CORNERS}f 1", "/"),
    },
    "PLY": {
        "faces": ply,
        "3 billion vertices": lambda _: PLY.replace("vertex 3", "vertex 3000000000").encode(),
        "properties": filled(PLY_HEAD, "property float p{0}\n".format, "end_header\n"),
    },
    "COLLADA": {"the same shape": same_shape, "nodes twice in one another": nodes_twice, "indices": indices},
    "glTF": {
        "nodes in one another": lambda size: gltf(
            [{"children": [i + 1]} for i in range(40 * size)] + [{"mesh": 0}], [0]
        ),
        "billion of vertices": lambda _: gltf([{"mesh": 0}], [0], 1_000_000_000, view=False),
        "nodes": lambda size: gltf([{"mesh": 0}] * (50 * size), [*range(50 * size)]),
    },
    "columns": {"names of columns": columns},
}
"""Reader -> name of a file -> what makes it."""
REFUSED = {
    "a long name", "attributes", "numbers in one place", "roots", "entities", "a field twice", "brackets",
    "digits", "columns and rows", "a column twice", "commas", "lines", "quotes", "members", "names in YAML",
    "brackets in YAML", "brackets of a job", "dashes", "a sum", "statements", "parentheses", "signs",
    "messages without data",
    "states without data", "a list in a header", "brackets in a header",
    "members of a chunk", "members of a map", "members of a policy",
    "members of key points", "spaces", "slashes",
    "3 billion vertices", "properties", "nodes twice in one another", "nodes in one another",
    "billion of vertices", "nodes",
}  # fmt: skip
"""Names of files of which even a small one is refused."""
LARGE = {name: (kind, name not in REFUSED) for kind, files in FILES.items() for name in files}
"""Name of a file -> its reader, and whether a small one of the kind is read."""


def reader_of(file: str) -> Reader:
    """Return the reader of "name, size kB"; its file is not damaged."""
    name, _, size_text = file.rpartition(", ")
    size = int(size_text.split()[0])
    kind = LARGE[name][0]
    build = FILES[kind][name]
    reader = replace(READERS[kind], damage=lambda _: build(size))
    if kind in ("CSV", "Parquet", "JSON", "NPZ", "ROS YAML", "NAOqi script", "MCAP"):
        reader = replace(reader, read=with_path(load, motion))  # once, without a robot
    return reader
