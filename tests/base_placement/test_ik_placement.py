"""Where to stand: places are checked on the fixed robot, with targets and obstacles moved to it instead."""

import math
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.base_placement import PlacementStatus, PlacementWeights
from pepper_kin.base_placement.floor_picture import save_floor_picture
from pepper_kin.base_placement.moving_base import moving_base
from pepper_kin.exceptions import InvalidValueError, LimitError

PEPPER = pk.load_pepper()
POINT = np.array([2.0, 0.4, 0.9])
LEFT = pk.ik.HandPosition("left", POINT)
TABLE = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(2.0, 0.0, 0.70))
EDGE = np.array([1.8, 0.15, 0.85])

ARM = """<robot name="crane">
  <link name="foot"/>
  <link name="upper"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"><inertial><origin xyz="0.25 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="foot"/><child link="upper"/>
    <origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="tip"/>
    <origin xyz="0.5 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="3"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def over_the_table():
    return pk.base_placement.place_base(PEPPER, [pk.ik.HandPosition("left", EDGE)], scene=TABLE)


def in_base(placement, point):
    """The point in the coordinates of the base, by turning it back."""
    x, y = point[0] - placement.x, point[1] - placement.y
    c, s = math.cos(-placement.yaw), math.sin(-placement.yaw)
    return np.array([c * x - s * y, s * x + c * y, point[2]])


def hand(q, frame="LArm_effector"):
    return pk.kinematics.frame_pose(PEPPER, q, frame)


def random_pose(seed):
    q = np.random.default_rng(seed).uniform(PEPPER.lower_limits, PEPPER.upper_limits)
    turn = np.array([[0.0, -1.0, 0.0, 1.5], [1.0, 0.0, 0.0, -1.0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return turn @ hand(q)


def test_every_placement_reaches_by_forward_kinematics_of_the_fixed_robot():
    gaze = pk.ik.LookAt(POINT)
    result = pk.base_placement.place_base(PEPPER, [LEFT, gaze], keep=4, collisions=False)
    assert result.status is PlacementStatus.FOUND
    assert result.success
    assert 1 < len(result.placements) <= 4
    for place in result.placements:
        assert place.success
        assert place.q.shape == (1, PEPPER.n)
        target = in_base(place, POINT)
        np.testing.assert_allclose(hand(place.q[0])[:3, 3], target, atol=1e-3)
        camera = hand(place.q[0], "CameraTop_frame")
        sight = target - camera[:3, 3]
        angle = math.acos(min(1.0, camera[:3, 0] @ sight / np.linalg.norm(sight)))
        assert angle <= math.radians(0.5) + 1e-9
        assert (place.q >= PEPPER.lower_limits).all()
        assert (place.q <= PEPPER.upper_limits).all()
        np.testing.assert_allclose(
            (place.transform_base_to_world @ [*target, 1])[:3], POINT, atol=1e-12
        )  # fmt: skip
        np.testing.assert_allclose(place.results[0].q[:3], [place.x, place.y, place.yaw], atol=1e-12)


def test_placements_are_ranked_and_lie_apart():
    result = pk.base_placement.place_base(PEPPER, LEFT, collisions=False)
    scores = [place.score for place in result.placements]
    assert scores == sorted(scores, reverse=True)
    assert result.best is result.placements[0]
    for i, a in enumerate(result.placements):
        for b in result.placements[:i]:
            turn = abs((a.yaw - b.yaw + math.pi) % (2 * math.pi) - math.pi)
            assert math.hypot(a.x - b.x, a.y - b.y) >= 0.1 or turn >= 0.25
    # The score found by sampling and local search is not beaten by other samples.
    other = pk.base_placement.place_base(PEPPER, LEFT, seed=9, candidates=400, collisions=False)
    assert other.best.score == pytest.approx(result.best.score, abs=0.06)


def test_the_terms_are_what_they_say():
    stand = (0.3, -0.5, 0.4)
    result = pk.base_placement.place_base(
        PEPPER, LEFT, stand=stand, weights=PlacementWeights(travel=2.0), collisions=False
    )
    place, terms = result.best, result.best.terms
    q = place.q[0]
    moved = np.abs(pk.kinematics.frame_jacobian(PEPPER, q, "LArm_effector")[:3]).max(axis=0) > 1e-12
    half = (PEPPER.upper_limits - PEPPER.lower_limits) / 2
    margins = 1 - np.abs(q - (PEPPER.upper_limits + PEPPER.lower_limits) / 2) / half
    margins[~moved] = np.inf
    assert terms.limit_margin == pytest.approx(margins.min(), abs=1e-9)
    assert terms.tightest_joint == PEPPER.joint_names[int(margins.argmin())]
    samples = np.random.default_rng(5).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (3000, PEPPER.n))
    largest = pk.kinematics.manipulability(PEPPER, samples, "LArm_effector").max()
    here = float(pk.kinematics.manipulability(PEPPER, q, "LArm_effector"))
    assert terms.manipulability == pytest.approx(here / largest, rel=0.1)
    assert terms.clearance is None
    assert terms.distance == pytest.approx(math.hypot(place.x - 0.3, place.y + 0.5))
    assert math.cos(terms.turn) == pytest.approx(math.cos(place.yaw - 0.4))
    near = 1 / (1 + terms.distance + 0.3 * terms.turn)
    assert place.score == pytest.approx((terms.limit_margin + terms.manipulability + 2 * near) / 4)


def test_what_weighs_more_comes_out_better():
    only = {"limit_margin": 0.0, "manipulability": 0.0, "clearance": 0.0, "travel": 0.0}
    near = pk.base_placement.place_base(
        PEPPER, LEFT, weights=PlacementWeights(**(only | {"travel": 1.0})), collisions=False
    ).best
    skilled = pk.base_placement.place_base(
        PEPPER, LEFT, weights=PlacementWeights(**(only | {"manipulability": 1.0})), collisions=False
    ).best
    loose = pk.base_placement.place_base(
        PEPPER, LEFT, weights=PlacementWeights(**(only | {"limit_margin": 1.0})), collisions=False
    ).best
    assert near.terms.distance < min(skilled.terms.distance, loose.terms.distance)
    assert skilled.terms.manipulability > max(near.terms.manipulability, loose.terms.manipulability)
    assert loose.terms.limit_margin > max(near.terms.limit_margin, skilled.terms.limit_margin)


def test_with_a_scene_nothing_touches(over_the_table):
    """The fixed robot, with the table moved the other way round, is as clear as the result says."""
    assert over_the_table.success, over_the_table.report()
    for place in over_the_table.placements:
        q = place.q[0]
        moved = TABLE.move("table", in_base(place, (2.0, 0.0, 0.70)), rpy=(0, 0, -place.yaw))
        np.testing.assert_allclose(hand(q)[:3, 3], in_base(place, EDGE), atol=1e-3)
        assert not pk.collision.in_collision(PEPPER, q, moved)
        assert place.terms.clearance >= float(pk.collision.clearance(PEPPER, q, moved)) - 1e-9
        assert place.results[0].clearance.least == pytest.approx(
            float(pk.collision.clearance(PEPPER, q, moved)), abs=1e-9
        )
        assert place.results[0].clearance.sentence() in place.results[0].report()
    assert over_the_table.touching.any()
    assert "of them in collision" in over_the_table.report()


def test_one_place_for_several_targets():
    points = np.array([[2.0, 0.4, 0.9], [2.2, 0.2, 0.7], [1.9, 0.5, 1.1]])
    apart = [[pk.ik.HandPosition("left", point)] for point in points]
    result = pk.base_placement.place_base(PEPPER, apart, collisions=False)
    assert result.success, result.report()
    assert result.reached.shape[1] == len(result.names) == len(result.best.q) == 3
    for q, point in zip(result.best.q, points, strict=True):
        np.testing.assert_allclose(hand(q)[:3, 3], in_base(result.best, point), atol=1e-3)
    together = pk.base_placement.place_base(PEPPER, pk.ik.HandPosition("left", points), collisions=False)
    np.testing.assert_array_equal(together.places, result.places)
    np.testing.assert_array_equal(together.best.q, result.best.q)


def test_neither_threads_nor_repetition_change_anything():
    sets = [[pk.ik.HandPosition("left", EDGE)], [LEFT]]
    results = [
        pk.base_placement.place_base(PEPPER, sets, scene=TABLE, threads=k, seed=4, candidates=60)
        for k in (1, 1, 2)
    ]
    for other in results[1:]:
        np.testing.assert_array_equal(other.places, results[0].places)
        np.testing.assert_array_equal(other.scores, results[0].scores)
        np.testing.assert_array_equal(other.best.q, results[0].best.q)
    assert not np.array_equal(
        pk.base_placement.place_base(PEPPER, sets, seed=5, scene=TABLE, candidates=60).places,
        results[0].places,
    )


def test_turning_the_world_turns_the_answer():
    """Targets, current place and candidates moved alike: the same is reached, with the same scores."""
    generator = np.random.default_rng(2)
    places = np.column_stack(
        [generator.uniform(-0.8, 0.8, (40, 2)) + POINT[:2], generator.uniform(-3, 3, 40)]
    )
    turn, shift = 1.1, np.array([3.0, -2.0])
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    there = np.column_stack([places[:, :2] @ rotation.T + shift, places[:, 2] + turn])
    moved = np.array([*(rotation @ POINT[:2] + shift), POINT[2]])
    one = pk.base_placement.place_base(PEPPER, LEFT, candidates=places, collisions=False)
    two = pk.base_placement.place_base(
        PEPPER, pk.ik.HandPosition("left", moved), candidates=there, stand=(*shift, turn), collisions=False
    )
    np.testing.assert_array_equal(one.reached, two.reached)
    np.testing.assert_allclose(one.scores, two.scores, atol=1e-3)
    assert 5 < one.reached.sum() < 35


def test_reached_is_what_solve_finds_from_each_place():
    generator = np.random.default_rng(3)
    places = np.column_stack(
        [generator.uniform(-0.9, 0.9, (40, 2)) + POINT[:2], generator.uniform(-3, 3, 40)]
    )
    found = pk.base_placement.place_base(PEPPER, LEFT, candidates=places, collisions=False)
    np.testing.assert_allclose(found.places[1:], places)
    solved = []
    for x, y, yaw in places:
        c, s = math.cos(yaw), math.sin(yaw)
        dx, dy = POINT[:2] - (x, y)
        point = (c * dx + s * dy, -s * dx + c * dy, POINT[2])
        solved.append(pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), collisions=False).success)
    assert np.sum(np.array(solved) != found.reached[1:, 0]) <= 1
    assert not found.reached[0, 0]
    assert not found.here


def test_status_unreachable_names_the_target():
    sets = [[LEFT], [pk.ik.HandPosition("right", (2.0, 0.0, 2.5))]]
    result = pk.base_placement.place_base(PEPPER, sets, candidates=48, collisions=False)
    assert result.status is PlacementStatus.UNREACHABLE
    assert not result.success
    assert result.unreached == (1,)
    assert "target 2 (right hand) out of reach from every place" in result.report()
    assert result.advice in result.report()
    assert result.best.score == 0.0
    short = re.search(r"right hand stops ([\d.]+) (c?m) short of \(2.000, 0.000, 2.500\)", result.report())
    place, q = result.best, result.best.q[1]
    distance = np.linalg.norm(hand(q, "RArm_effector")[:3, 3] - in_base(place, (2.0, 0.0, 2.5)))
    assert float(short[1]) * (0.01 if short[2] == "cm" else 1) == pytest.approx(distance, abs=0.006)


def test_contradictory_tasks_are_named_as_solve_names_them():
    """They were called out of reach, each of them is within it."""
    pair = [pk.ik.HandPosition("left", (2.0, 0.4, 0.9)), pk.ik.HandPosition("left", (2.0, 0.2, 0.9))]
    far = pk.ik.HandPosition("right", (2.0, 0.0, 2.5))
    result = pk.base_placement.place_base(PEPPER, pair, candidates=48, collisions=False)
    assert result.status is PlacementStatus.UNREACHABLE
    (conflict,) = result.conflicts
    planar = pk.load_pepper(base="planar")
    assert conflict == pk.ik.solve(planar, pair, collisions=False).conflict
    assert f"of target 1, {' and '.join(conflict)} contradict each other" in result.report()
    assert "out of reach from every place" not in result.report()
    assert result.advice.startswith("Each of the tasks that are named can be met, but not all together")

    both = pk.base_placement.place_base(PEPPER, [pair, [far]], candidates=48, collisions=False)
    assert both.conflicts == (conflict, ())
    assert "target 2 (right hand) out of reach from every place; of target 1" in both.report()
    # Each hand's point is reached from somewhere, and both from nowhere.
    apart = [pk.ik.HandPosition("left", (0.3, 0.3, 0.9)), pk.ik.HandPosition("right", (9.0, 0.0, 0.9))]
    result = pk.base_placement.place_base(PEPPER, apart, candidates=48, collisions=False)
    assert len(result.conflicts[0]) == 2


def test_status_not_together():
    sets = [[LEFT], [pk.ik.HandPosition("left", (6.0, 0.4, 0.9))]]
    result = pk.base_placement.place_base(PEPPER, sets, candidates=48, collisions=False)
    assert result.status is PlacementStatus.NOT_TOGETHER
    assert result.unreached == ()
    assert result.reached.any(axis=0).all()
    assert "no place reaches all targets" in result.report()
    assert "which reaches 1 of 2" in result.report()


def test_status_blocked_by_collision():
    inside = pk.ik.HandPosition("left", (2.0, 0.0, 0.70))
    result = pk.base_placement.place_base(PEPPER, inside, scene=TABLE, candidates=12)
    assert result.status is PlacementStatus.BLOCKED_BY_COLLISION
    assert "in collision" in result.report()
    assert pk.base_placement.place_base(PEPPER, inside, candidates=12, collisions=False).success
    assert len({status.advice for status in PlacementStatus}) == len(PlacementStatus) == 4


def test_a_place_that_serves_already_is_kept():
    for task in (
        pk.ik.LookAt((3.0, 0.5, 1.0)),
        pk.ik.JointPosture(PEPPER.neutral()),
        pk.ik.Point("left", (1, 0, 0)),
    ):
        result = pk.base_placement.place_base(
            PEPPER, task, candidates=24, weights=PlacementWeights(0, 0, 0, 1), collisions=False
        )
        assert result.here
        assert result.best.terms.distance == 0.0
        assert "the current place serves too" in result.report()
        assert result.best.terms.manipulability is None


@pytest.mark.parametrize(
    "task",
    [
        pk.ik.HandPose("left", random_pose(3)),
        pk.ik.FramePose("LArm_effector", random_pose(4)),
        pk.ik.FrameOrientation("LArm_effector", random_pose(5)[:3, :3]),
        pk.ik.FramePosition("CameraTop_frame", (1.0, 1.0, 1.05)),
        pk.ik.AxisAlignment("LArm_effector", (0.0, -1.0, 0.2)),
        pk.ik.HandPosition("right", (-1.0, 0.3, 0.6)),
    ],
    ids=lambda task: type(task).__name__,
)
def test_every_kind_of_task(task):
    result = pk.base_placement.place_base(PEPPER, task, candidates=64, collisions=False)
    assert result.success, result.report()
    planar = pk.load_pepper(base="planar")
    place = result.best
    q = planar.joint_vector({"BaseX": place.x, "BaseY": place.y, "BaseYaw": place.yaw})
    q[[planar.joint_index(name) for name in PEPPER.joint_names]] = place.q[0]
    for part in task.parts if isinstance(task, pk.ik.TaskGroup) else (task,):
        assert part.error(planar, q) <= part.tolerance


def test_a_planar_robot_stays_itself():
    planar = pk.load_pepper(base="planar")
    q0 = planar.joint_vector({"BaseX": 0.5, "BaseYaw": 0.3})
    result = pk.base_placement.place_base(planar, LEFT, q0, candidates=48, collisions=False)
    np.testing.assert_allclose(result.places[0], [0.5, 0.0, 0.3])
    place = result.best
    assert place.q.shape == (1, 18)
    np.testing.assert_allclose(place.q[0, :3], [place.x, place.y, place.yaw])
    np.testing.assert_allclose(
        pk.kinematics.frame_pose(planar, place.q[0], "LArm_effector")[:3, 3], POINT, atol=1e-3
    )
    with pytest.raises(LimitError, match="BaseX"):
        pk.base_placement.place_base(planar, LEFT, candidates=[(11.0, 0.0, 0.0)], collisions=False)


def test_any_fixed_robot_can_be_placed():
    """A crane that reaches in one vertical plane only: the places lie on a ring, turned to the target."""
    crane = pk.load_robot(ARM)
    task = pk.ik.FramePosition("tip", (1.0, 2.0, 1.3))
    result = pk.base_placement.place_base(crane, task, candidates=64, collisions=False)
    assert result.success, result.report()
    for place in result.placements:
        dx, dy = 1.0 - place.x, 2.0 - place.y
        # The tip's origin is the elbow: 0.5 m from the shoulder, 0.3 m above it, so 0.4 m ahead or behind.
        assert math.hypot(dx, dy) == pytest.approx(0.4, abs=2e-3)
        assert abs(math.sin(math.atan2(dy, dx) - place.yaw)) < 5e-3


def test_the_robot_on_a_moving_base_is_the_robot_moved():
    """Frames, center of mass and gravity torques, against the fixed robot and a rigid transform."""
    moving = moving_base(PEPPER)
    generator = np.random.default_rng(7)
    for _ in range(5):
        q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        x, y, yaw = generator.uniform(-3, 3, 3)
        state = moving.states(q, np.array([[x, y, yaw]]))[0]
        c, s = math.cos(yaw), math.sin(yaw)
        carry = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])
        for frame in ("LArm_effector", "CameraTop_frame", "base_link"):
            there = pk.kinematics.frame_pose(moving.robot, state, frame)
            np.testing.assert_allclose(there, carry @ hand(q, frame), atol=1e-12)
        mass = [*pk.dynamics.center_of_mass(PEPPER, q), 1.0]
        np.testing.assert_allclose(
            pk.dynamics.center_of_mass(moving.robot, state), (carry @ mass)[:3], atol=1e-12
        )
        np.testing.assert_allclose(
            pk.dynamics.gravity_torque(moving.robot, state)[moving.body],
            pk.dynamics.gravity_torque(PEPPER, q),
            atol=1e-9,
        )
    assert moving_base(PEPPER) is moving
    planar = pk.load_pepper(base="planar")
    assert moving_base(planar).robot is planar


@pytest.mark.thorough
@pytest.mark.parametrize("hands", ["mimic", "independent"])
def test_robots_with_fingers(hands):
    pepper = pk.load_pepper(hands=hands)
    result = pk.base_placement.place_base(pepper, LEFT, candidates=32, collisions=False)
    assert result.success, result.report()
    pose = pk.kinematics.frame_pose(pepper, result.best.q[0], "LArm_effector")
    np.testing.assert_allclose((result.best.transform_base_to_world @ pose)[:3, 3], POINT, atol=1e-3)


def test_a_result_travels():
    result = pk.base_placement.place_base(PEPPER, LEFT, candidates=16, collisions=False)
    copy = pickle.loads(pickle.dumps(result))
    assert copy.report() == result.report()
    np.testing.assert_array_equal(copy.best.q, result.best.q)


def test_only_the_named_joints_move():
    result = pk.base_placement.place_base(PEPPER, LEFT, joints="left_arm", collisions=False)
    assert result.success
    still = [i for i, name in enumerate(PEPPER.joint_names) if name not in PEPPER.joint_group("left_arm")]
    np.testing.assert_array_equal(result.best.q[0, still], PEPPER.neutral()[still])


def test_the_placement_map_agrees_with_place_base():
    calls = []
    found = pk.base_placement.placement_map(
        PEPPER,
        LEFT,
        center=POINT[:2],
        size=1.6,
        resolution=0.2,
        headings=6,
        progress=calls.append,
        collisions=False,
    )
    assert found.scores.shape == found.yaws.shape == (8, 8)
    assert calls == sorted(calls)
    assert len(calls) == 8
    assert calls[-1] == 1.0
    assert found.area == pytest.approx(0.04 * np.isfinite(found.scores).sum())
    np.testing.assert_array_equal(np.isfinite(found.scores), np.isfinite(found.yaws))
    for center in found.centers[::7]:
        best = found.score_at(center)
        yaws = np.arange(6) * math.pi / 3
        places = np.column_stack([np.tile(center, (6, 1)), yaws])
        one = pk.base_placement.place_base(PEPPER, LEFT, candidates=places, collisions=False)
        assert one.scores[1:].max() == pytest.approx(best, abs=1e-9)
    assert math.isnan(found.score_at((100.0, 0.0)))
    with pytest.raises(ValueError, match="read-only"):
        found.scores[0, 0] = 1.0
    sampled = pk.base_placement.place_base(PEPPER, LEFT, collisions=False).score_map(0.2)
    assert np.nanmax(sampled.scores) == pytest.approx(np.nanmax(found.scores), abs=0.1)


def test_the_picture_is_a_png(tmp_path):
    found = pk.base_placement.place_base(PEPPER, LEFT, candidates=64, collisions=False).score_map()
    path = save_floor_picture(found, tmp_path / "floor.png", [POINT])
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InvalidValueError, match="targets"):
        save_floor_picture(found, tmp_path / "floor.png", [[np.nan, 0, 0]])


def test_the_example_of_the_page_runs():
    page = (Path(__file__).parents[2] / "docs" / "ik.md").read_text(encoding="utf-8")
    code = next(c for c in re.findall(r"```python\n(.*?)```", page, re.S) if "place_base" in c)
    names = {"pk": pk, "pepper": PEPPER}
    exec(code, names)
    place = names["place"]
    assert names["result"].success
    np.testing.assert_allclose(hand(place.q[0])[:3, 3], in_base(place, names["cup"]), atol=1e-3)
    for term in ("limit_margin", "manipulability", "clearance", "travel"):
        assert f"| `{term}` |" in page
