"""Planning for robots of meshes, from the package example-robot-data: Panda and Talos."""

import importlib.metadata
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.motion import PlanStatus
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.problem import path_problem
from pepper_kin.trajectory.path import as_cubic_path

STEP = 1e-3  # [m] of the fastest point


def load(urdf, srdf):
    package = importlib.metadata.distribution("example-robot-data")
    share = Path(package.locate_file("cmeel.prefix/share"))
    robots = share / "example-robot-data" / "robots"
    semantics = None if srdf is None else robots / srdf
    return pk.load_robot(robots / urdf, semantics, [share], acceleration_limits=5.0)


class Case:
    """A robot at rest, a scene, and a motion of one arm whose straight line goes through a post."""

    def __init__(self, robot, rest, scene, group, ends):
        self.robot, self.scene, self.group = robot, scene, group
        self.start, self.goal = (robot_with(robot, rest, end) for end in ends)


def robot_with(robot, rest, values):
    q = np.array(rest)
    for name, value in values.items():
        q[robot.joint_index(name)] = value
    return q


def panda():
    robot = load("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf")
    scene = pk.Scene().add_box("table", (0.6, 1.2, 0.04), (0.55, 0.0, 0.1))
    scene = scene.add_box("post", (0.08, 0.08, 0.8), (0.5, 0.0, 0.5))
    rest = robot_with(
        robot, robot.neutral(), {"panda_joint2": 0.4, "panda_joint4": -1.8, "panda_joint6": 2.2}
    )
    return Case(robot, rest, scene, "arm", ({"panda_joint1": -0.8}, {"panda_joint1": 0.8}))


def talos():
    robot = load("talos_data/robots/talos_reduced.urdf", "talos_data/srdf/talos.srdf")
    scene = pk.Scene().add_box("table", (0.5, 1.2, 0.04), (0.6, 0.0, -0.25))
    scene = scene.add_box("post", (0.06, 0.06, 0.8), (0.42, 0.32, 0.3))
    rest = robot_with(robot, robot.neutral(), robot.semantics.states["all", "half_sitting"])
    lifted = {"arm_left_2_joint": 0.25, "arm_left_4_joint": -1.4}
    ends = (lifted | {"arm_left_1_joint": -0.8}, lifted | {"arm_left_1_joint": 0.4})
    return Case(robot, rest, scene, "l_arm", ends)


@pytest.fixture(scope="module", params=[panda, talos], ids=["panda", "talos"])
def case(request):
    return request.param()


def along(robot, path):
    """States along the spline that `retime` draws, no further apart than STEP."""
    spline, reach, states = as_cubic_path(robot, path), motion_bounds(robot), []
    for i, length in enumerate(np.diff(spline.breaks)):
        coarse = spline.at(np.full(20, i), np.linspace(0, length, 20))
        count = int(np.ceil((np.abs(np.diff(coarse, axis=0)) @ reach).sum() / STEP)) + 1
        states.append(spline.at(np.full(count, i), np.linspace(0, length, count)))
    return np.concatenate(states)


def assert_free(case, states):
    """By coal alone; what does not move stands still, and limits are kept."""
    robot = case.robot
    assert not pk.collision.checker_for(robot, case.scene).in_collision(states).any()
    arm = [robot.joint_index(name) for name in robot.joint_group(case.group)]
    still = np.setdiff1d(np.arange(robot.n), arm)
    np.testing.assert_array_equal(states[:, still], np.tile(case.start[still], (len(states), 1)))
    assert np.all(states >= robot.lower_limits - 1e-9)
    assert np.all(states <= robot.upper_limits + 1e-9)


@pytest.mark.thorough
def test_no_point_moves_faster_than_the_metric_says(case):
    """Corners of meshes are points of the body, too."""
    import coal
    import pinocchio

    robot, reach = case.robot, motion_bounds(case.robot)
    rng = np.random.default_rng(2)
    model, data = robot.pinocchio_model, robot.pinocchio_model.createData()
    step = 1e-6
    lower, upper = np.clip(robot.lower_limits, -3, 3), np.clip(robot.upper_limits, -3, 3)
    shapes = [s for s in robot.collision_shapes if isinstance(s.geometry, pk.model.Mesh)]
    assert len(shapes) > 5
    for shape in shapes:
        mesh = coal.MeshLoader().load(str(shape.geometry.path), np.array(shape.geometry.scale))
        corners = np.c_[mesh.vertices(), np.ones(mesh.num_vertices)] @ shape.transform_shape_to_link.T
        frame = robot.frame_id(shape.link)

        def places(q, frame=frame, corners=corners):
            pinocchio.framesForwardKinematics(model, data, robot.to_full(q))
            return corners @ data.oMf[frame].homogeneous.T

        q = rng.uniform(lower, upper)
        for j in range(robot.n):
            moved = np.linalg.norm(places(q + step * np.eye(robot.n)[j]) - places(q), axis=1).max()
            assert moved / step <= reach[j] + 1e-6, (shape.link, robot.joint_names[j])


@pytest.mark.thorough
@pytest.mark.parametrize("planner", ["rrt_connect", "aorrtc"])
def test_plan_goes_round_the_post(case, planner):
    straight = case.start + np.linspace(0, 1, 200)[:, None] * (case.goal - case.start)
    assert pk.collision.in_collision(case.robot, straight, case.scene).any()
    plan = pk.plan(
        case.robot, case.start, case.goal, case.scene, planner=planner, joints=case.group, timeout=3.0
    )
    assert plan.status is PlanStatus.SOLVED, plan.message
    np.testing.assert_array_equal(plan.path[0], case.start)
    np.testing.assert_allclose(plan.path[-1], case.goal, atol=1e-12)
    assert_free(case, along(case.robot, plan.path))


def problem_of(case):
    free = np.array([case.robot.joint_index(name) for name in case.robot.joint_group(case.group)])
    checks = Checks(case.robot, case.scene)
    return path_problem(checks, case.start, case.goal[None], free, 0.01)


@pytest.mark.thorough
def test_the_improving_planner_shortens_what_the_first_path_was(case):
    whole = problem_of(case)
    problem = whole.search_problem
    first = planners.rrt_connect(problem, seed=1, timeout=20.0)
    assert first.success
    best = planners.aorrtc(problem, first.path, seed=1, timeout=1.0)
    assert best.cost < 0.98 * first.cost
    # The certificate looks between the states that the search did, where a margin may be a little less.
    assert planners.certify(whole.relaxed, best.path).success


def test_a_roadmap_answers_there_and_back(case):
    case_problem = problem_of(case)
    problem, embed = case_problem.search_problem, case_problem.embed
    roadmap = planners.Roadmap(problem)
    there = roadmap.solve(problem.start, problem.goals, timeout=20.0)
    back = roadmap.solve(problem.goals[0], problem.start[None], timeout=20.0)
    for found in (there, back):
        assert found.success
        points = found.path.points
        reach = problem.metric.weights
        for a, b in pairwise(points):
            count = int(np.ceil(np.linalg.norm(reach * (b - a)) / STEP)) + 1
            assert_free(case, embed(a + np.linspace(0, 1, count)[:, None] * (b - a)))
    assert back.iterations == 0  # the map did not have to grow


def test_ik_tasks_as_goal(case):
    """The hand at a point that it reached before, the arm as it likes."""
    frame = "panda_link8" if case.group == "arm" else "arm_left_7_link"
    target = pk.kinematics.frame_pose(case.robot, case.goal, frame)[:3, 3]
    plan = pk.plan(
        case.robot, case.start, [pk.ik.FramePosition(frame, target)], case.scene, joints=case.group,
        timeout=6.0,
    )  # fmt: skip
    assert plan.success, plan.report()
    reached = pk.kinematics.frame_pose(case.robot, plan.goal, frame)[:3, 3]
    assert np.linalg.norm(reached - target) < 1e-3
    assert_free(case, along(case.robot, plan.path)[::4])


@pytest.mark.thorough
def test_what_stands_near_is_left_to_coal():
    """Hulls of links that do not move overlap, the meshes do not: straight ways that are free are plans."""
    robot = load("tiago_description/robots/tiago_no_hand.urdf", None)
    rest = robot.joint_vector(
        {"arm_1_joint": 0.5, "arm_2_joint": -0.5, "arm_3_joint": -1.0, "torso_lift_joint": 0.15}
    )
    exact, rng, solved = pk.collision.checker_for(robot, None), np.random.default_rng(3), 0
    arm = np.array([robot.joint_index(f"arm_{k}_joint") for k in (4, 5, 6)])
    start, states = robot_with(robot, rest, {"arm_4_joint": 1.8}), np.tile(rest, (200, 1))
    states[:, arm] = rng.uniform(robot.lower_limits[arm], robot.upper_limits[arm], (200, 3))
    free = Checks(robot, None).along(start, arm, (0.0, 0.0))(states)
    np.testing.assert_array_equal(free, ~exact.in_collision(states))
    assert free.any()
    for turn, other in rng.uniform((1.6, 1.6), (1.9, 1.9), (20, 2)):
        start, goal = (robot_with(robot, rest, {"arm_4_joint": angle}) for angle in (turn, other))
        free = not exact.in_collision(start + np.linspace(0, 1, 100)[:, None] * (goal - start)).any()
        plan = pk.plan(robot, start, goal, timeout=1.0)
        assert plan.success or not free, plan.message
        solved += plan.success
    assert solved >= 10


def hollow_shelf(folder):
    """A shelf in one mesh, two boards and a back, whose hull holds the room between the boards."""
    boards = [((0.5, 0.6, 0.02), (0.6, 0.0, 0.6)), ((0.02, 0.6, 1.4), (0.85, 0.0, 0.7))]
    boards.append(((0.5, 0.6, 0.02), (0.6, 0.0, 1.25)))
    parts = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in boards
    ]
    trimesh.util.concatenate(parts).export(folder / "shelf.stl")
    return pk.Scene().add_mesh("shelf", folder / "shelf.stl")


@pytest.mark.thorough
@pytest.mark.parametrize("constraints", [None, [pk.ik.CenterOfMassOverWheels(0.01)]])
def test_ends_in_the_hollow_of_a_mesh_are_planned_from_and_to(tmp_path, constraints):
    """Machine code takes the mesh for its hull, in which both ends are; coal takes it as it is."""
    pepper, scene = pk.load_pepper(), hollow_shelf(tmp_path)
    inside = pk.ik.solve(pepper, [pk.ik.HandPosition("left", (0.42, 0.2, 0.8))], scene=scene)
    other = pk.ik.solve(pepper, [pk.ik.HandPosition("left", (0.42, 0.15, 0.85))], inside.q, scene=scene)
    exact, ready = pk.collision.checker_for(pepper, scene), pepper.posture("Ready")
    for start, goal in ((inside.q, other.q), (ready, inside.q), (other.q, ready)):
        plan = pk.plan(pepper, start, goal, scene, constraints=constraints)
        assert plan.success, plan.report()
        assert not exact.in_collision(along(pepper, plan.path)).any()
        np.testing.assert_allclose(plan.path[-1], goal, atol=1e-12)
    board = pk.ik.solve(pepper, [pk.ik.HandPosition("left", (0.5, 0.2, 0.6))], collisions=False).q
    blocked = pk.plan(pepper, ready, board, scene, constraints=constraints)
    assert not blocked.success
    assert "shelf" in blocked.message
