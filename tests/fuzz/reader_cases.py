"""Every public reader of files: whole files for it, how these are damaged, and what a result must be.

This is no test: `reader_process.py` runs the cases in processes that may end.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mutations import Rng, changed_bytes, pick
from reader_checks import (
    bag,
    dataset,
    dataset_job,
    exports,
    mesh,
    motion,
    points,
    policy,
    reach,
    recording,
    report,
    require,
    robot,
    run,
    scene,
    table,
    timelines,
)
from reader_damage import (
    archive_damage,
    bag_damage,
    chunk_damage,
    header_damage,
    json_damage,
    mcap_damage,
    text_damage,
    xml_damage,
)
from reader_files import (
    BEHAVIOR,
    COLLADA,
    DATASET_JOB,
    EXPORT,
    OBJ,
    PLY,
    POINTS,
    PROJECT,
    ROBOT,
    SCENE,
    SRDF,
    STL,
    XACRO,
    binary_stl,
    dataset_files,
    gltf_binary,
    packed,
    point_arrays,
    policy_arrays,
    reach_arrays,
    recording_files,
    run_file,
    sample,
    trajectory_file,
    turning,
)

from pepper_kin.collision import Scene
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.datasets import load_job
from pepper_kin.files import (
    load,
    load_columns,
    load_table,
    read_choregraphe,
    read_joint_states,
    read_naoqi_export,
)
from pepper_kin.files.choregraphe_boxes import ChoregrapheBox, read_behavior
from pepper_kin.identification import read_log
from pepper_kin.jobs import load_motion
from pepper_kin.kinematics import ReachMap
from pepper_kin.learning import load_policy
from pepper_kin.model import audit, compare, load_pepper, load_robot, pepper_urdf
from pepper_kin.motion import read_key_points
from pepper_kin.ros_messages import Bag
from pepper_kin.twin import load_run
from pepper_kin.twin.recording_header import HEADER


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
        motion(load(path, pepper=turning() if suffix == ".py" else sample()))

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
    motion(read_joint_states(sample(), path, ignore=("WheelB",)))


ROBOT_LOG = "time,A_command,A_measured,B_command,B_measured\n" + "".join(
    f"{2.0 + 0.2 * k:.1f},{0.1 * k:.2f},{0.09 * k:.2f},-0.5,{-0.01 * k:.2f}\n" for k in range(12)
)


def robot_log(path: Path) -> None:
    """Read a robot's log; what is accepted is finite, in order and of plausible angles."""
    found = read_log(path)
    assert np.isfinite(found.measured).all()
    assert np.isfinite(found.command).all()
    assert (np.diff(found.time) > 0).all()
    assert np.abs(found.measured).max() <= 2.0 * np.pi


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
SHARD = next(name for name in dataset_files() if name.endswith(".parquet"))
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
    "Parquet": trajectory_reader(".parquet", lambda rng: changed_bytes(trajectory_file(".parquet"), rng)),
    "JSON": trajectory_reader(".json", json_damage(lambda: json.loads(trajectory_file(".json")))),
    "NPZ": trajectory_reader(".npz", archive_damage(lambda: trajectory_file(".npz"))),
    "ROS YAML": trajectory_reader(".yaml", _trajectory_text(".yaml")),
    "NAOqi script": trajectory_reader(".py", _trajectory_text(".py")),
    "MCAP": trajectory_reader(".mcap", mcap_damage),
    "robot's log": Reader("person_a_log.csv", robot_log, text_damage(ROBOT_LOG)),
    "joint states CSV": Reader("states.csv", states, _trajectory_text(".csv")),
    "joint states MCAP": Reader("states.mcap", states, mcap_damage),
    "bag": Reader("bag.mcap", with_path(Bag, bag), bag_damage),
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
    "Choregraphe boxes": Reader(
        "behavior.xar",
        with_path(read_behavior, lambda found: require(isinstance(found, ChoregrapheBox), "boxes")),
        xml_damage(BEHAVIOR),
    ),
    "Choregraphe project": Reader(
        "project.pml",
        with_path(read_choregraphe, timelines),
        xml_damage(PROJECT),
        beside=lambda: {"behavior.xar": BEHAVIOR.encode()},
    ),
    "Choregraphe export": Reader("export.py", with_path(read_naoqi_export, timelines), text_damage(EXPORT)),
    "run": Reader("run.csv", lambda path: run(load_run(sample(), path)), _run_text),
    "motion": Reader("run.csv", lambda path: motion(load_motion(sample(), path)), _run_text),
    "recording header": Reader(
        HEADER, lambda path: recording(path.parent), header_damage, beside=others(HEADER)
    ),
    "recording": Reader(
        "000000.npz", lambda path: recording(path.parent), chunk_damage, beside=others("000000.npz")
    ),
    "reach map": Reader(
        "map.npz", with_path(ReachMap.load, reach), archive_damage(lambda: packed(reach_arrays()))
    ),
    "policy": Reader(
        "policy.npz", with_path(load_policy, policy), archive_damage(lambda: packed(policy_arrays()))
    ),
    "dataset job": Reader("mine.yaml", with_path(load_job, dataset_job), text_damage(DATASET_JOB)),
    "manifest": Reader(
        "manifest.json",
        lambda path: dataset(path.parent),
        json_damage(lambda: json.loads(dataset_files()["manifest.json"])),
        "manifest",
        beside=lambda: {k: v for k, v in dataset_files().items() if k != "manifest.json"},
    ),
    "shard": Reader(
        SHARD,
        lambda path: dataset(path.parents[1]),
        lambda rng: changed_bytes(dataset_files()[SHARD], rng),
        beside=lambda: {k: v for k, v in dataset_files().items() if k != SHARD},
    ),
    "key points": Reader(
        "points.npz", with_path(read_key_points, points), archive_damage(lambda: packed(point_arrays()))
    ),
    "key points CSV": Reader("points.csv", with_path(read_key_points, points), text_damage(POINTS)),
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
