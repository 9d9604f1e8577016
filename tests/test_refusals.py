"""Refusals by name: huge whole numbers, lists of unequal lengths, NaN, texts that are no path."""

import math
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.base_placement import PlacementWeights, place_base
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access.atomic_file import as_path, write_text
from pepper_kin.files import load_table, read_naoqi_export, save_table
from pepper_kin.motion.optimization.cost import Cost
from pepper_kin.trajectory import Key, OnlineMotion, active_limits, check, phase_plane
from pepper_kin.twin.base import (
    BalanceMonitor,
    Odometry,
    OmniBase,
    arc_moved,
    edge_moments,
    simulate_tipping,
    world_velocity,
)
from pepper_kin.twin.sensors import Intrinsics, RayCaster, published_scan

HUGE = 10**400
RAGGED = [[1.0, 2.0], [3.0]]


@pytest.fixture(scope="module")
def robot():
    return pk.load_pepper()


@pytest.fixture(scope="module")
def motion(robot):
    return pk.retime(robot, [robot.posture("Stand"), robot.joint_vector({"RElbowRoll": 0.8})])


def square():
    """Return a problem without obstacles in the unit square."""
    free = lambda x: np.ones(len(x), dtype=bool)  # noqa: E731
    return planners.Problem([0.0, 0.0], [1.0, 1.0], [0.1, 0.1], [0.9, 0.9], free, resolution=0.05)


def hand():
    return pk.ik.HandPosition("left", (0.38, 0.22, 0.82))


def line(rows=1, **options):
    return planners.ConstraintManifold(lambda x: None, 2, rows, **options)


WHOLE_NUMBERS = [
    ("restarts", lambda r: pk.ik.solve(r, hand(), restarts=HUGE)),
    ("max_iterations", lambda r: pk.ik.solve(r, hand(), max_iterations=2**31)),
    ("starts", lambda r: pk.ik.solutions(r, hand(), starts=2**63)),
    ("restarts", lambda r: pk.ik.solve_batch(r, pk.ik.HandPosition("left", np.ones((2, 3))), restarts=HUGE)),
    ("samples", lambda r: pk.kinematics.reach_map(r, "LArm_effector", samples=10**18)),
    ("candidates", lambda r: place_base(r, [hand()], candidates=HUGE)),
    ("count", lambda r: pk.TwinBatch(r, HUGE)),
    ("intervals", lambda r: pk.motion.optimize(r, [r.posture("Stand"), r.neutral()], intervals=HUGE)),
    ("max_iterations", lambda r: pk.motion.optimize(r, bend(r), max_iterations=HUGE)),
    ("max_iterations", lambda r: pk.motion.minimum_torque_trajectory(r, *bend(r), 2.0, max_iterations=HUGE)),
    ("edge", lambda r: moments_of(r, edge=2**63)),
    ("width", lambda r: Intrinsics(HUGE, 10, 60.0, 60.0, 5.0, 5.0)),
    ("max_iterations", lambda r: planners.rrt_connect(square(), max_iterations=HUGE)),
    ("iterations", lambda r: planners.shortcut(square(), diagonal(), iterations=2**31)),
    ("segments", lambda r: planners.rounded_waypoints(diagonal(), HUGE)),
    ("count", lambda r: planners.first_invalid_states(square(), [[0.5, 0.5]], 2**63)),
    ("rows", lambda r: line(rows=HUGE)),
]


def diagonal():
    return planners.Path([[0.1, 0.1], [0.9, 0.9]])


def report_of(robot, rows=5):
    still = np.tile(robot.posture("Stand"), (rows, 1))
    monitor = BalanceMonitor(robot)
    return monitor, monitor.assess(np.linspace(0, 0.1, rows), still, 0 * still, 0 * still), still


def moments_of(robot, q=None, edge=0):
    monitor, report, still = report_of(robot)
    return edge_moments(monitor, report, still if q is None else q, edge)


def tipping_of(robot, **options):
    monitor, report, still = report_of(robot)
    return simulate_tipping(monitor, report, **{"q": still, **options})


def test_a_huge_whole_number_is_refused_with_the_largest_allowed(robot):
    for quantity, call in WHOLE_NUMBERS:
        with pytest.raises(
            InvalidValueError, match=rf"^{quantity}: got .* expected an integer from \d+ to \d+$"
        ):
            call(robot)


def test_a_seed_may_be_huge(robot):
    assert planners.rrt_connect(square(), seed=HUGE).success
    assert pk.ik.solve(robot, hand(), seed=2**80).success


NUMBERS = [
    ("position", lambda r: pk.model.pose(RAGGED)),
    ("quaternion (xyzw)", lambda r: pk.model.rotation_from_quaternion(RAGGED)),
    ("pose", lambda r: arc_moved(RAGGED, (0, 0, 0))),
    ("radius_error", lambda r: Odometry(OmniBase(), radius_error=RAGGED)),
    ("seed", lambda r: Odometry(OmniBase(), seed=-1)),
    ("twist", lambda r: world_velocity(RAGGED, 0.0)),
    ("yaw", lambda r: world_velocity((0, 0, 0), [])),
    ("q", lambda r: moments_of(r, q="")),
    ("q", lambda r: moments_of(r, q=np.full((5, r.n), math.nan))),
    ("edge", lambda r: moments_of(r, edge=math.nan)),
    ("edge", lambda r: moments_of(r, edge=3)),
    ("q", lambda r: tipping_of(r, q=RAGGED)),
    ("start", lambda r: tipping_of(r, start={})),
    ("restitution", lambda r: tipping_of(r, restitution=[])),
    ("laser_left", lambda r: published_scan(r, np.ones(15), np.ones(15), "")),
    ("laser_right", lambda r: published_scan(r, np.full(15, math.nan), np.ones(15), np.ones(15))),
    ("k1", lambda r: Intrinsics(4, 3, 60.0, 60.0, 5.0, 5.0, k1=math.nan)),
    ("fx", lambda r: Intrinsics(4, 3, -1.0, 60.0, 5.0, 5.0)),
    ("poses", lambda r: RayCaster([], np.eye(4)[None])),
    ("weight of travel", lambda r: PlacementWeights(travel=HUGE)),
    ("candidates", lambda r: place_base(r, [hand()], candidates=RAGGED)),
    ("weight of l_hand", lambda r: pk.ik.FramePosition("l_hand", (0, 0, 1), weight=HUGE)),
    ("lower bound of x", lambda r: pk.ik.Expression(r, lambda q: q[0], lower=HUGE, label="x")),
    ("function of x", lambda r: pk.ik.Expression(r, int, label="x")),
    ("jerk", lambda r: pk.retime(r, [r.posture("Stand"), r.neutral()], jerk=HUGE)),
    ("balance", lambda r: check(r, still_motion(r), balance=math.nan)),
    ("balance", lambda r: active_limits(r, still_motion(r), balance=[])),
    ("t", lambda r: active_limits(r, still_motion(r), "")),
    ("points", lambda r: phase_plane(r, still_motion(r), points=2**63)),
    ("q", lambda r: OnlineMotion(r, RAGGED)),
    ("key", lambda r: Key([], 0.1)),
    ("weight of jerk", lambda r: Cost(jerk=RAGGED)),
    ("velocity_scale", lambda r: pk.motion.optimize(r, [r.neutral()] * 2, velocity_scale=RAGGED)),
    ("seed", lambda r: pk.motion.optimize(r, bend(r), seed=-1)),
    ("seed", lambda r: pk.motion.simplify_path(r, bend(r), seed=-1)),
    ("duration", lambda r: pk.motion.optimize(r, bend(r), duration=1e300)),
    ("margin", lambda r: pk.motion.validate(r, bend(r), margin=[])),
    ("start", lambda r: pk.motion.PlanProblem(r, np.array("text"), r.neutral()).solve()),
    ("faces of a mesh", lambda r: pk.collision.TriangleMesh(np.eye(3), RAGGED)),
    ("points of a cloud", lambda r: pk.collision.PointCloud(RAGGED, 0.01)),
    ("objects", lambda r: pk.Scene("no such thing")),
    ("allowed", lambda r: pk.Scene(allowed="no such thing")),
    ("allowed", lambda r: pk.Scene(allowed=[("a", 1)])),
    ("timeout", lambda r: planners.rrt_connect(square(), timeout=HUGE)),
    ("gap", lambda r: planners.aorrtc(square(), gap=HUGE)),
    ("step", lambda r: planners.rrt_connect(square(), step=HUGE)),
    ("lower", lambda r: planners.Problem(RAGGED, [1, 1], [0, 0], [1, 1], lambda x: x)),
    ("weights", lambda r: planners.Path([[0.0], [1.0]], RAGGED)),
    ("groups", lambda r: line(groups=math.nan)),
    ("tolerances", lambda r: line(tolerances="")),
    ("states", lambda r: planners.first_invalid_states(square(), [[0.5, 1e300]], 3)),
    ("states", lambda r: planners.first_invalid_states(square(), [[0.5, math.inf]], 3)),
    ("n", lambda r: planners.StateCost(lambda x: x, math.nan)),
    ("package_dirs", lambda r: pk.load_robot(r.urdf, package_dirs="x" * 5000)),
    ("package_dirs", lambda r: pk.model.audit(r.urdf, package_dirs="x" * 5000)),
]


def bend(robot):
    return [robot.posture("Stand"), robot.joint_vector({"RElbowRoll": 0.8})]


def still_motion(robot):
    return pk.retime(robot, bend(robot))


def test_what_is_no_number_or_no_list_of_its_shape_is_refused_by_name(robot):
    for quantity, call in NUMBERS:
        with pytest.raises(InvalidValueError) as refused:
            call(robot)
        assert refused.value.quantity.partition("[")[0] == quantity
        assert refused.value.allowed


def test_names_of_columns_that_are_no_texts_are_refused(tmp_path):
    path = save_table({"time": [0.0, 1.0]}, tmp_path / "table.csv")
    with pytest.raises(InvalidValueError, match="expected: got "):
        load_table(path, [None, 1.0])


def test_jerk_limits_that_are_all_infinite_do_not_act(robot, motion):
    path = [robot.posture("Stand"), robot.joint_vector({"RElbowRoll": 0.8})]
    assert pk.retime(robot, path, jerk=math.inf).duration == motion.duration
    some = np.full(robot.n, math.inf)
    some[robot.joint_index("HeadYaw")] = 10.0  # which does not move
    assert pk.retime(robot, path, jerk=some).duration == pytest.approx(motion.duration, rel=0.1)


@pytest.mark.parametrize("name", ["\0", "a\0b", "\ud800"])
def test_a_text_that_no_file_can_be_named_is_refused_as_a_file(name, tmp_path):
    for call in (
        lambda: as_path(name),
        lambda: write_text(f"{tmp_path}/{name}", "text"),
        lambda: save_table({"time": [0.0, 1.0]}, f"{tmp_path}/{name}"),
        lambda: load_table(name),
        lambda: pk.load_pepper(meshes=name),
    ):
        with pytest.raises(FileFormatError, match="cannot be the name of a file"):
            call()
    assert not list(tmp_path.iterdir())


def test_a_name_that_is_too_long_or_empty_is_refused_as_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileFormatError, match="is not a folder"):
        pk.load_pepper(meshes="x" * 5000)
    with pytest.raises(FileFormatError, match="it is a folder"):
        save_table({"time": [0.0, 1.0]}, "")
    assert as_path(Path("a")) == Path("a")
    with pytest.raises(InvalidValueError, match=r"path: got b'a'"):
        as_path(b"a")


def test_an_unknown_quantity_with_half_a_character_is_refused(robot):
    with pytest.raises(pk.PepperKinError, match="unknown quantity"):
        pk.batch.kernel(robot, "\ud800")


def test_a_run_of_too_many_steps_is_refused(robot, motion):
    with pytest.raises(InvalidValueError, match=r"duration and hold_time: got .* at most 10,000,000 steps"):
        pk.Twin(robot).execute(motion, hold_time=1e9)


def test_a_number_of_5000_digits_in_a_script_of_choregraphe_is_refused_by_the_file(tmp_path):
    path = tmp_path / "export.py"
    path.write_text(f'names.append("HeadYaw")\ntimes.append([{"9" * 4000}])\nkeys.append([0.5])\n')
    with pytest.raises(FileFormatError, match=r"export.py: key of HeadYaw at 9+\.\.\. s"):
        read_naoqi_export(path)
    path.write_text(f'names.append("HeadYaw")\ntimes.append([0x{"9" * 5000}])\nkeys.append([0.5])\n')
    with pytest.raises(FileFormatError, match=r"export.py: key of HeadYaw at a value of type int"):
        read_naoqi_export(path)


def test_a_shaft_between_two_balls_at_one_place_is_no_capsule():
    parts = "".join(
        f'<collision name="a_{name}"><geometry>{shape}</geometry></collision>'
        for name, shape in (
            ("shaft", '<cylinder radius="0.05" length="0.3"/>'),
            ("start", '<sphere radius="0.05"/>'),
            ("end", '<sphere radius="0.05"/>'),
        )
    )
    joint = (
        '<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>'
    )
    urdf = f'<robot name="r"><link name="base"/><link name="a">{parts}</link>{joint}</robot>'
    assert [shape.name for shape in pk.load_robot(urdf).collision_shapes] == ["a_shaft", "a_start", "a_end"]
