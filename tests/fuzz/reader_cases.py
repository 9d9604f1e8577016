"""Every public reader of files: whole files for it, how these are damaged, and what a result must be.

This is no test: `reader_process.py` runs the cases in processes that may end.
"""

from __future__ import annotations

import io
import json
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
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

import pepper_kin as pk
from pepper_kin.collision import Scene
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.files import (
    load,
    load_columns,
    load_table,
    read_choregraphe,
    read_joint_states,
    read_naoqi_export,
    save,
)
from pepper_kin.jobs import load_motion
from pepper_kin.kinematics import ReachMap
from pepper_kin.model import FORMATS, audit, compare, load_pepper, load_robot, pepper_urdf
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import Recorder, load_recording, load_run
from pepper_kin.twin.recording_header import HEADER

ROBOT = """<?xml version="1.0"?>
<robot name="sample">
  <material name="blue"><color rgba="0 0 0.8 1"/></material>
  <link name="base"><visual name="plate"><origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/>
    <geometry><box size="0.2 0.3 0.1"/></geometry><material name="blue"/></visual>
    <collision><geometry><cylinder radius="0.1" length="0.2"/></geometry></collision></link>
  <link name="arm"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.5"/><mass value="1.5"/>
    <inertia ixx="0.01" ixy="0.001" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
    <collision name="c_shaft"><geometry><cylinder radius="0.05" length="0.3"/></geometry></collision>
    <collision name="c_start"><origin xyz="0 0 -0.15"/><geometry><sphere radius="0.05"/></geometry>
    </collision>
    <collision name="c_end"><origin xyz="0 0 0.15"/><geometry><sphere radius="0.05"/></geometry>
    </collision></link>
  <link name="slide"><inertial><mass value="0.5"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>
    <visual><geometry><mesh filename="part.stl" scale="0.001 0.001 0.001"/></geometry></visual></link>
  <link name="finger"/><link name="wheel"/><link name="tip"/>
  <joint name="elbow" type="revolute"><origin xyz="0 0 0.3" rpy="0 0 1.57"/><parent link="base"/>
    <child link="arm"/><axis xyz="0 0 1"/><limit lower="-1.5" upper="2" effort="10" velocity="3"/>
    <dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="rail" type="prismatic"><origin xyz="0.3 0 0"/><parent link="arm"/><child link="slide"/>
    <axis xyz="1 0 0.5"/><limit lower="0" upper="0.4" effort="50" velocity="1" acceleration="5"/></joint>
  <joint name="grip" type="revolute"><parent link="slide"/><child link="finger"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/>
    <mimic joint="elbow" multiplier="0.5" offset="0.1"/></joint>
  <joint name="roll" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 1 0"/></joint>
  <joint name="mount" type="fixed"><origin xyz="0 0 0.1"/><parent link="slide"/><child link="tip"/></joint>
</robot>
"""
SRDF = """<?xml version="1.0"?>
<robot name="sample">
  <virtual_joint name="fixed_base" type="fixed" parent_frame="world" child_link="base"/>
  <group name="arm"><joint name="elbow"/><joint name="rail"/></group>
  <group name="all"><group name="arm"/><chain base_link="base" tip_link="tip"/><link name="wheel"/></group>
  <group_state name="home" group="arm"><joint name="elbow" value="0.5"/><joint name="rail" value="0.1"/>
  </group_state>
  <end_effector name="hand" parent_link="tip" group="arm"/>
  <passive_joint name="roll"/>
  <disable_default_collisions link="wheel"/>
  <enable_collisions link1="wheel" link2="arm"/>
  <disable_collisions link1="base" link2="arm" reason="Adjacent"/>
</robot>
"""
XACRO = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="sample">
<xacro:arg name="length" default="0.3"/><xacro:property name="half" value="0.15"/>
<xacro:macro name="part" params="name"><link name="${name}"/></xacro:macro>
<xacro:part name="a"/><link name="b"/><xacro:include filename="other.xacro"/>
<joint name="j" type="fixed"><parent link="a"/><child link="b"/><origin xyz="${half} 0 0"/></joint></robot>
"""
BEHAVIOR = """<?xml version="1.0" encoding="UTF-8" ?>
<ChoregrapheProject xmlns="http://www.aldebaran-robotics.com/schema/choregraphe/project.xsd" xar_version="3">
<Box name="root"><Timeline enable="0"><BehaviorLayer name="layer"><BehaviorKeyframe name="k" index="1">
<Diagram>
<Box name="Hello" id="2"><Timeline enable="1" fps="25" start_frame="1" end_frame="-1" size="60">
<ActuatorList model="">
<ActuatorCurve name="value" actuator="HeadYaw" mute="0" unit="0"><Key frame="11" value="30"/>
<Key frame="21" value="-10"><Tangent side="left" interpType="linear" abscissaParam="0" ordinateParam="0"/>
<Tangent side="right" interpType="bezier" abscissaParam="3" ordinateParam="2"/></Key></ActuatorCurve>
<ActuatorCurve name="value" actuator="RHand" mute="0" unit="1"><Key frame="11" value="0.6"/></ActuatorCurve>
</ActuatorList></Timeline></Box></Diagram></BehaviorKeyframe></BehaviorLayer></Timeline></Box>
</ChoregrapheProject>
"""
PROJECT = """<?xml version="1.0" encoding="UTF-8" ?>
<Package name="p" format_version="4"><BehaviorDescriptions>
<BehaviorDescription name="behavior" src="." xar="behavior.xar"/></BehaviorDescriptions></Package>
"""
EXPORT = """# Choregraphe bezier export in Python.
from naoqi import ALProxy
names = list()
times = list()
keys = list()

names.append("HeadPitch")
times.append([0.4, 0.8])
keys.append([[0.1, [3, -0.13, 0], [3, 0.13, 0]], [-0.2, [3, -0.13, 0], [3, 0, 0]]])

names.append("HeadYaw")
times.append([0.4])
keys.append([0.5])
"""
SCENE: dict[str, Any] = {
    "format": "pepper_kin scene",
    "version": 1,
    "units": "m",
    "objects": [
        {"name": "table", "kind": "box",
        "size": [0.6, 1.0, 0.04], "position": [0.55, 0, 0.7], "rpy": [0, 0, 0.5]},
        {"name": "ball", "kind": "sphere", "radius": 0.1, "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
        {"name": "floor", "kind": "half-space", "offset": 0.0, "color": [0.5, 0.5, 0.5, 1.0]},
        {"name": "can", "kind": "cylinder", "radius": 0.1, "length": 0.2},
        {"name": "wedge", "kind": "convex mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]},
        {
            "name": "sheet", "kind": "triangle mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            "faces": [[0, 1, 2]], "padding": 0.01,
        },
        {"name": "dust", "kind": "point cloud", "points": [[0.5, 0, 0], [1.0, 0, 0]], "radius": 0.01},
    ],
    "attached": [{"name": "cup", "kind": "capsule", "radius": 0.03, "length": 0.1, "frame": "l_gripper",
    "touch_links": ["l_wrist"]}],
    "allowed": [["floor", "Tibia"]],
}  # fmt: skip
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1/1 3/2 2/3\nf 1 2 4\nf -4 -1 -2\n"
STL = """solid part
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 1 0
 endloop
endfacet
endsolid part
"""
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified><unit meter="0.01"/>
</asset>
<library_geometries><geometry id="shape"><mesh><source id="p">
<float_array id="pa" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3</p></triangles></mesh>
</geometry>
</library_geometries>
<library_nodes><node id="part"><instance_geometry url="#shape"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s"><node><translate>1 2 3</translate><instance_node url="#part"/>
</node>
<node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#shape"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


class WrongResultError(Exception):
    """What a reader returned is not what a reader may return."""


def require(fact: object, what: str) -> None:
    """Raise where a result is not sound."""
    if not fact:
        raise WrongResultError(what)


@dataclass(frozen=True)
class Reader:
    """A reader and how its files are damaged.

    Attributes:
        file: Name of the file, which decides how it is read.
        read: Reads the file and checks what it returns.
        damage: Returns a damaged file.
        named: What each refusal must name; the file's name if empty.
        beside: Whole files beside it.
    """

    file: str
    read: Callable[[Path], object]
    damage: Callable[[Rng], bytes]
    named: str = ""
    beside: Callable[[], dict[str, bytes]] = dict


def finite(*arrays: Any) -> None:
    """Require finite numbers."""
    for array in arrays:
        values = np.asarray(array)
        require(values.dtype.kind in "fiub" and np.isfinite(values).all(), f"numbers {str(array)[:60]}")


# What a result must be.


def robot(model: pk.PepperModel) -> None:
    """Require ordered limits, finite places and masses, and exports that are texts or refusals."""
    lower, upper = model.lower_limits, model.upper_limits
    require(model.n > 0 and not np.isnan(lower).any() and (lower <= upper).all(), "limits")
    for limits in (model.velocity_limits, model.acceleration_limits, model.effort_limits):
        require((limits >= 0).all(), "a limit below zero")
    finite(
        model.full_map,
        model.full_offset,
        model.neutral(),
        model.posture(model.posture_names[0]) if model.posture_names else 0.0,
    )
    inner = model.inner_model
    for placement, inertia in zip(inner.jointPlacements, inner.inertias, strict=True):
        finite(placement.homogeneous, inertia.matrix())
    for shape in (*model.visual_shapes, *model.collision_shapes):
        finite(shape.transform_shape_to_link, shape.color)
    finite(*pk.kinematics.frame_poses(model, model.neutral(), model.frame_names[:50]))
    finite(pk.dynamics.inverse_dynamics(model, model.neutral(), np.zeros(model.n), np.zeros(model.n)))
    for group in model.group_names:
        model.joint_group(group)


def exports(model: pk.PepperModel) -> None:
    """Require that each export is a text that reads back, or the library's refusal."""
    for format in FORMATS:
        try:
            text = model.export(format)
            text.encode()
        except pk.PepperKinError:
            continue
        if format == "urdf":
            again = load_robot(text)
            require(again.joint_names == model.joint_names, "an export of other joints")
            require(np.array_equal(again.lower_limits, model.lower_limits), "an export of other limits")


def report(found: Any) -> None:
    """Require an audit or comparison that can be printed and written."""
    found.report().encode("utf-8", "replace")
    json.dumps(found.to_dict(), default=str)


def motion(trajectory: Any) -> None:
    """Require a trajectory of finite numbers, or a run."""
    if isinstance(trajectory, Trajectory):
        finite(trajectory.breaks, trajectory.coefficients)
        require(trajectory.breaks[0] == 0.0 and (np.diff(trajectory.breaks) > 0).all(), "times")
    else:
        run(trajectory)


def run(found: Any) -> None:
    """Require a run of finite numbers and of one length."""
    finite(found.time, found.position, found.velocity, found.torque)
    require(len(found.time) == len(found.position) == len(found.velocity) == len(found.torque), "lengths")


def timelines(found: Any) -> None:
    """Require curves of finite keys."""
    for timeline in found if isinstance(found, tuple) else (found,):
        for curve in timeline.curves:
            finite([key.time for key in curve.keys], [key.value for key in curve.keys])
            require(isinstance(curve.joint, str), "a joint's name")


def table(columns: dict[str, Any]) -> None:
    """Require columns of one length."""
    finite(*columns.values())
    require(len({len(column) for column in columns.values()}) == 1, "lengths")


def scene(found: Scene) -> None:
    """Require finite places."""
    for item in found.objects.values():
        finite(item.transform_object_to_world, item.color)
        rotation = item.transform_object_to_world[:3, :3]
        require(np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4), "a rotation")
    for hung in found.attached.values():
        finite(hung.transform_object_to_frame)


def mesh(found: tuple[Any, Any]) -> None:
    """Require triangles of vertices that there are."""
    vertices, faces = found
    finite(vertices)
    require(faces.shape[1] == 3 and faces.min() >= 0 and faces.max() < len(vertices), "faces")


def reach(found: ReachMap) -> None:
    """Require counts on a grid."""
    finite(found.origin, found.resolution, found.best, found.volume, found.centers)
    require((found.counts >= 0).all() and found.resolution > 0 and found.samples >= 0, "counts")


def recording(folder: Path) -> None:
    """Read all of a recording."""
    found = load_recording(folder)
    require(found.timestep > 0 and math.isfinite(found.timestep), "timestep")
    run(found.run())
    for series in found.readings().values():
        require(len(series.time) == len(series.value) == len(series.truth), "readings")
    for inputs in found.inputs():
        finite(*inputs.values())


# How whole files are made.


@cache
def pepper() -> pk.PepperModel:
    """Return the robot of most files."""
    return load_pepper()


@cache
def sample() -> pk.PepperModel:
    """Return a small robot."""
    return load_robot(ROBOT)


@cache
def turning() -> pk.PepperModel:
    """Return a small robot whose joints all turn."""
    return load_robot(ROBOT.replace("prismatic", "revolute"))


@cache
def trajectory_file(suffix: str) -> bytes:
    """Return a trajectory in a format."""
    import tempfile

    times = np.array([0.0, 0.5, 1.0, 1.5])
    q = np.array([[0.0, 0.1, 0.0], [0.3, 0.2, 1.0], [0.5, 0.3, 0.5], [0.2, 0.1, 0.0]])
    trajectory = Trajectory.from_positions(
        times, q, turning() if suffix == ".py" else sample(), overshoot=1e3
    )
    with tempfile.TemporaryDirectory() as folder:
        dt = {} if suffix in (".npz", ".json") else {"dt": 0.25}
        return save(trajectory, Path(folder) / f"motion{suffix}", unchecked=True, **dt).read_bytes()


@cache
def run_file() -> bytes:
    """Return a run of the twin."""
    names = [
        f"{name}.{q}"
        for q in ("position", "velocity", "torque", "reference", "reference_velocity")
        for name in sample().joint_names
    ]
    rows = [",".join(["time", *names])] + [
        ",".join([repr(0.1 * i), *(["0.25"] * len(names))]) for i in range(4)
    ]
    return ("\n".join(rows) + "\n").encode()


@cache
def recording_files() -> dict[str, bytes]:
    """Return the files of a recording of half a second."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(pk.Twin(pepper()), Path(folder) / "run", chunk=0.02)
        recorder.hold(0.06) if hasattr(recorder, "hold") else recorder.follow(
            np.tile(pepper().neutral(), (30, 1))
        )
        return {path.name: path.read_bytes() for path in (Path(folder) / "run").iterdir()}


@cache
def reach_arrays() -> dict[str, Any]:
    """Return the arrays of a reach map."""
    return {
        "format": np.array("pepper_kin reach map 1"), "frame": np.array("LArm_effector"),
        "joints": np.array(["HeadYaw", "HipRoll"]), "origin": np.zeros(3), "resolution": np.array(0.05),
        "counts": np.ones((2, 3, 2), np.int64), "best": np.ones((2, 3, 2), np.float32),
        "samples": np.array(12), "seed": np.array(0),
    }  # fmt: skip


def packed(arrays: dict[str, Any]) -> bytes:
    """Return a NumPy archive."""
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return content.getvalue()


def arrays_of(content: bytes) -> dict[str, Any]:
    """Return what a NumPy archive holds."""
    with np.load(io.BytesIO(content)) as archive:
        return {name: archive[name] for name in archive.files}


@cache
def binary_stl() -> bytes:
    """Return an STL file of three triangles."""
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles = np.zeros(3, kind)
    triangles["corners"] = np.random.default_rng(0).random((3, 3, 3))
    return bytes(80) + (3).to_bytes(4, "little") + triangles.tobytes()


@cache
def gltf_binary() -> bytes:
    """Return a glTF file of one triangle."""
    import trimesh

    return bytes(trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(file_type="glb"))


# How files are damaged.


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

    from pepper_kin.files import mcap_file

    content = io.BytesIO()
    writer = Writer(content)
    schema = writer.register_msgdef(mcap_file.STATE_TYPE, mcap_file.STATE_SCHEMA)
    whole = writer.register_msgdef("trajectory_msgs/msg/JointTrajectory", mcap_file._TRAJECTORY_SCHEMA)
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


def with_path(read: Callable[[Path], Any], check: Callable[[Any], None]) -> Callable[[Path], object]:
    """Return a function that reads a file and checks the result."""
    return lambda path: check(read(path))


def text_of(path: Path) -> str:
    """Return a file's text as a caller may have it, halves of characters included."""
    return path.read_bytes().decode("utf-8", "surrogatepass")


def robot_of_text(path: Path) -> None:
    """Read a robot from its text."""
    try:
        text = text_of(path)
    except UnicodeDecodeError:
        return
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        found = load_robot(text)
        robot(found)
        exports(found)


def with_semantics(path: Path) -> None:
    """Read a robot with the text of its groups."""
    try:
        text = text_of(path)
    except UnicodeDecodeError:
        return
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        found = load_robot(ROBOT, text)
        robot(found)
        exports(found)


def robot_on_wheels(path: Path) -> None:
    """Read a robot on a base that moves."""
    robot(load_robot(path, base="planar", acceleration_limits=5.0))


def trajectory_reader(suffix: str, damage: Callable[[Rng], bytes]) -> Reader:
    """Return the reader of a trajectory in a format."""

    def read(path: Path) -> None:
        motion(load(path))
        motion(load(path, turning() if suffix == ".py" else sample()))

    return Reader(f"motion{suffix}", read, damage)


def _trajectory_text(suffix: str) -> Callable[[Rng], bytes]:
    return lambda rng: text_damage(trajectory_file(suffix).decode())(rng)


def beside_robot() -> dict[str, bytes]:
    """Return the mesh that the robot shows."""
    return {"part.stl": binary_stl()}


def vendor(path: Path) -> None:
    """Load Pepper with somebody's meshes, and look at the file."""
    found = load_pepper(meshes=path.parent)
    mesh(read_mesh(next(s for s in found.visual_shapes if s.link == "Head").geometry.path))


def states(path: Path) -> None:
    """Read joint states of the small robot."""
    motion(read_joint_states(path, sample(), ignore=("WheelB",)))


def others(name: str) -> Callable[[], dict[str, bytes]]:
    """Return what makes the files of a recording but one."""
    return lambda: {other: content for other, content in recording_files().items() if other != name}


def _run_text(rng: Rng) -> bytes:
    return text_damage(run_file().decode())(rng)


def _column(unit: str, quantity: str, joint: str | None) -> dict[str, Any]:
    return {"unit": unit, "quantity": quantity, "joint": joint}


COLUMNS = {
    "time": _column("s", "time", None),
    "rail.position": _column("m", "position", "rail"),
    "elbow.position": _column("rad", "position", "elbow"),
}
READERS: dict[str, Reader] = {
    "URDF": Reader("robot.urdf", with_path(load_robot, robot), xml_damage(ROBOT), beside=beside_robot),
    "URDF text": Reader("robot.urdf", robot_of_text, xml_damage(ROBOT), "URDF"),
    "URDF on a base": Reader("robot.urdf", robot_on_wheels, xml_damage(ROBOT)),
    "URDF of Pepper": Reader(
        "robot.urdf", with_path(load_robot, robot), lambda rng: xml_damage(pepper_urdf())(rng)
    ),
    "xacro": Reader("robot.urdf.xacro", with_path(load_robot, robot), xml_damage(XACRO)),
    "SDF": Reader(
        "robot.sdf", with_path(load_robot, robot), lambda rng: xml_damage(sample().export("sdf"))(rng)
    ),
    "SRDF": Reader("robot.srdf", lambda path: robot(load_robot(ROBOT, path)), xml_damage(SRDF)),
    "SRDF text": Reader("robot.srdf", with_semantics, xml_damage(SRDF), "SRDF"),
    "audit": Reader("robot.urdf", with_path(audit, report), xml_damage(ROBOT), beside=beside_robot),
    "audit of meshes": Reader(
        "part.stl",
        lambda path: report(audit(path.with_name("robot.urdf"))),
        lambda rng: changed_bytes(pick(rng, (binary_stl(), STL.encode())), rng),
        beside=lambda: {"robot.urdf": ROBOT.encode()},
    ),
    "compare": Reader("robot.urdf", lambda path: report(compare(path, ROBOT)), xml_damage(ROBOT)),
    "scene": Reader("scene.json", with_path(Scene.load, scene), json_damage(lambda: SCENE)),
    "CSV": trajectory_reader(".csv", _trajectory_text(".csv")),
    "JSON": trajectory_reader(".json", json_damage(lambda: json.loads(trajectory_file(".json")))),
    "NPZ": trajectory_reader(".npz", archive_damage(lambda: trajectory_file(".npz"))),
    "ROS YAML": trajectory_reader(".yaml", _trajectory_text(".yaml")),
    "NAOqi script": trajectory_reader(".py", _trajectory_text(".py")),
    "MCAP": trajectory_reader(".mcap", mcap_damage),
    "joint states CSV": Reader("states.csv", states, _trajectory_text(".csv")),
    "joint states MCAP": Reader("states.mcap", states, mcap_damage),
    "table": Reader("table.csv", with_path(load_table, table), _trajectory_text(".csv")),
    "columns": Reader(
        "columns.json",
        with_path(load_columns, lambda found: require(isinstance(found, dict), "columns")),
        json_damage(lambda: COLUMNS),
    ),
    "columns of a CSV": Reader(
        "columns.json",
        lambda path: motion(load(path.with_name("motion.csv"))),
        json_damage(lambda: COLUMNS),
        beside=lambda: {"motion.csv": trajectory_file(".csv")},
    ),
    "Choregraphe behavior": Reader(
        "behavior.xar", with_path(read_choregraphe, timelines), xml_damage(BEHAVIOR)
    ),
    "Choregraphe project": Reader(
        "project.pml",
        with_path(read_choregraphe, timelines),
        xml_damage(PROJECT),
        beside=lambda: {"behavior.xar": BEHAVIOR.encode()},
    ),
    "Choregraphe export": Reader("export.py", with_path(read_naoqi_export, timelines), text_damage(EXPORT)),
    "run": Reader("run.csv", lambda path: run(load_run(path, sample())), _run_text),
    "motion": Reader("run.csv", lambda path: motion(load_motion(path, sample())), _run_text),
    "recording header": Reader(
        HEADER, lambda path: recording(path.parent), header_damage, beside=others(HEADER)
    ),
    "recording": Reader(
        "000000.npz", lambda path: recording(path.parent), chunk_damage, beside=others("000000.npz")
    ),
    "reach map": Reader(
        "map.npz", with_path(ReachMap.load, reach), archive_damage(lambda: packed(reach_arrays()))
    ),
    "STL": Reader(
        "part.stl", with_path(read_mesh, mesh), lambda rng: changed_bytes(binary_stl(), rng, (STL.encode(),))
    ),
    "STL text": Reader("part.stl", with_path(read_mesh, mesh), text_damage(STL)),
    "OBJ": Reader("part.obj", with_path(read_mesh, mesh), text_damage(OBJ)),
    "COLLADA": Reader("part.dae", with_path(read_mesh, mesh), xml_damage(COLLADA)),
    "PLY": Reader("part.ply", with_path(read_mesh, mesh), text_damage(PLY)),
    "glTF": Reader("part.glb", with_path(read_mesh, mesh), lambda rng: changed_bytes(gltf_binary(), rng)),
    "Pepper's meshes": Reader("Head.stl", vendor, lambda rng: changed_bytes(binary_stl(), rng)),
}
