"""Whole files for the readers: texts, and files that the library or NumPy writes."""

import io
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import pepper_kin as pk
from pepper_kin.datasets import load_job, make
from pepper_kin.files import save
from pepper_kin.model import load_pepper, load_robot
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import Recorder, Run

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
    times = np.array([0.0, 0.5, 1.0, 1.5])
    q = np.array([[0.0, 0.1, 0.0], [0.3, 0.2, 1.0], [0.5, 0.3, 0.5], [0.2, 0.1, 0.0]])
    trajectory = Trajectory.from_positions(
        turning() if suffix == ".py" else sample(), times, q, overshoot=1e3
    )
    with tempfile.TemporaryDirectory() as folder:
        dt = {} if suffix in (".npz", ".json") else {"dt": 0.25}
        return save(trajectory, Path(folder) / f"motion{suffix}", unchecked=True, **dt).read_bytes()


@cache
def run_file() -> bytes:
    """Return a run of the small robot, as it is saved."""
    names, rows = sample().joint_names, np.full((4, sample().n), 0.25)
    limits = sample().effort_limits
    run = Run(names, sample().joint_units, 0.1 * np.arange(4), rows, rows, rows, rows, rows, limits)
    with tempfile.TemporaryDirectory() as folder:
        return run.save(Path(folder) / "run.csv").read_bytes()


@cache
def recording_files() -> dict[str, bytes]:
    """Return the files of a recording of half a second."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(pk.Twin(pepper()), Path(folder) / "run", chunk=0.02)
        recorder.hold(0.06) if hasattr(recorder, "hold") else recorder.follow(
            np.tile(pepper().neutral(), (30, 1))
        )
        return {path.name: path.read_bytes() for path in (Path(folder) / "run").iterdir()}


DATASET_JOB = """\
job: pepper_kin data set job
version: 1
kind: ik
name: Reaching
rows: 40
rows_per_shard: 40
seed: 3
robot: {hands: locked}
targets: {hand: left, lower: [0.3, 0.0, 0.8], upper: [0.4, 0.2, 0.9], look: false}
planner: {collisions: false, restarts: 2}
"""


@cache
def dataset_files() -> dict[str, bytes]:
    """Return the files of a dataset by their names in its folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "mine.yaml").write_text(DATASET_JOB)
        make(load_job(folder / "mine.yaml"), folder / "set", workers=0)
        files = [path for path in (folder / "set").rglob("*") if path.is_file()]
        return {str(path.relative_to(folder / "set")): path.read_bytes() for path in files}


@cache
def reach_arrays() -> dict[str, Any]:
    """Return the arrays of a reach map."""
    return {
        "format": np.array("pepper_kin reach map 1"), "frame": np.array("LArm_effector"),
        "joints": np.array(["HeadYaw", "HipRoll"]), "origin": np.zeros(3), "resolution": np.array(0.05),
        "counts": np.ones((2, 3, 2), np.int64), "best": np.ones((2, 3, 2), np.float32),
        "samples": np.array(12), "seed": np.array(0),
    }  # fmt: skip


def policy_arrays(hidden: int = 3) -> dict[str, Any]:
    """Return the arrays of a policy with a layer of so many numbers."""
    return {
        "format": np.array("pepper_kin policy 1"), "task": np.array("Reach"),
        "center": np.zeros(4, np.float32), "scale": np.ones(4, np.float32),
        "weight_0": np.full((4, hidden), 0.1, np.float32), "bias_0": np.zeros(hidden, np.float32),
        "weight_1": np.full((hidden, 2), 0.1, np.float32), "bias_1": np.zeros(2, np.float32),
    }  # fmt: skip


def point_arrays(frames: int = 3) -> dict[str, Any]:
    """Return the arrays of key points over so many frames."""
    points = np.ones((frames, 2, 3))
    points[0, 1] = np.nan
    return {"points": points, "names": np.array(["LWrist", "nose"]), "times": np.arange(frames) / 30.0}


POINTS = "time,nose.x,nose.y,nose.z\n0,1,2,3\n0.1,,,\n0.2,1.5,nan,3\n"


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
