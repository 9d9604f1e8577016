"""Bounds of motion against many configurations, by Pinocchio, and against finite motions."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision.curve_examination import hull_of
from pepper_kin.collision.motion_tree import (
    Hull,
    bounds_anywhere,
    motion_bounds,
    motion_bounds_of,
    motion_tree,
)
from pepper_kin.kernels.compiled_function import CompiledFunction
from pepper_kin.kinematics import frame_pose
from pepper_kin.trajectory.path import as_cubic_path

PEPPER = pk.load_pepper()
CLOSE = 1.02
"""The bound is at most this many times the greatest speed that is found."""

SLIDER = """<robot name="slider"><link name="base"/><link name="arm"/><link name="tool"><collision>
<geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="tool"/><axis xyz="1 0 0"/>
<origin xyz="0.2 0 0"/><limit lower="-0.1" upper="0.5" effort="1" velocity="1"/></joint></robot>"""


def speeds(pepper, q):
    """Greatest distance of a point of the body from each joint's axis, shape (n,), at q, shape (m, n)."""
    model, tree = pepper.pinocchio_model, motion_tree(pepper)
    links = {model.frames[pepper.frame_id(name)].parentJoint: name for name in pepper.frame_names}
    poses = {}
    for joint in range(1, model.njoints):
        fixed = model.frames[pepper.frame_id(links[joint])].placement.homogeneous
        poses[joint] = frame_pose(pepper, q, links[joint]) @ np.linalg.inv(fixed)
    found = np.zeros(pepper.n)
    for body, carrier in enumerate(tree.carriers.tolist()):
        for ball in range(tree.first[body], tree.first[body + 1]) if carrier >= 0 else ():
            place = poses[carrier + 1] @ np.append(tree.centers[ball], 1.0)
            for joint in model.supports[carrier + 1].tolist()[1:]:
                axis = poses[joint][:, :3, :3] @ tree.axes[joint - 1]
                arm = place[:, :3] - poses[joint][:, :3, 3]
                along = np.einsum("ki,ki->k", arm, axis)
                off = np.sqrt(np.maximum(np.einsum("ki,ki->k", arm, arm) - along**2, 0.0).max())
                found[joint - 1] = max(found[joint - 1], off + tree.radii[ball])
    return found


@pytest.mark.thorough
def test_no_configuration_exceeds_the_bound_and_it_is_close():
    """Configurations, a third of them with joints at their limits, where arms are straight."""
    rng = np.random.default_rng(0)
    lower, upper = PEPPER.lower_limits, PEPPER.upper_limits
    q = rng.uniform(lower, upper, (20_000, PEPPER.n))
    ends = rng.random(q.shape)
    ends[: 2 * len(q) // 3] = 0.5
    q = np.where(ends < 0.3, lower, np.where(ends > 0.7, upper, q))
    bound, greatest = motion_bounds(PEPPER), np.zeros(PEPPER.n)
    for k in range(0, len(q), 5_000):
        greatest = np.maximum(greatest, speeds(PEPPER, q[k : k + 5_000]))
    assert (greatest <= bound).all()
    assert (bound <= CLOSE * greatest).all()
    assert (bounds_anywhere(PEPPER) >= bound - 1e-5).all()


def test_finite_motions_keep_the_bound():
    rng = np.random.default_rng(1)
    a, b = rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (2, 400, PEPPER.n))
    for bound, low, high in (
        (motion_bounds(PEPPER), PEPPER.lower_limits, PEPPER.upper_limits),
        (motion_bounds(PEPPER, PEPPER.lower_limits / 3, PEPPER.upper_limits / 3), None, None),
    ):
        scale = 1.0 if low is not None else 1 / 3
        tightest = 0.0
        for x, y in zip(scale * a, scale * b, strict=True):
            before, after = places(x), places(y)
            moved = np.linalg.norm(after - before, axis=1).max()
            assert moved <= bound @ np.abs(y - x)
            tightest = max(tightest, moved / (bound @ np.abs(y - x)))
        assert tightest > 0.3
        assert high is None or (bound > 0).all()


def places(q):
    model, tree = PEPPER.pinocchio_model, motion_tree(PEPPER)
    data = model.createData()
    pinocchio.forwardKinematics(model, data, q)
    bodies = np.repeat(tree.carriers, np.diff(tree.first))
    return np.array(
        [
            data.oMi[int(joint) + 1].act(center)
            for joint, center in zip(bodies, tree.centers, strict=True)
            if joint >= 0
        ]
    )


def test_narrow_ranges_have_smaller_bounds():
    """Where the arms hang they are nearer to the knee; a range of one pose tells exactly how near."""
    q = PEPPER.posture("Stand")
    here = motion_bounds(PEPPER, q, q)
    assert here == pytest.approx(np.maximum(speeds(PEPPER, q[None]), 1e-3), rel=1e-4)
    assert here[0] < 0.9 * motion_bounds(PEPPER)[0]


def test_travel_of_what_slides_counts(tmp_path):
    path = tmp_path / "slider.urdf"
    path.write_text(SLIDER)
    robot = pk.load_robot(path)
    turn, slide = robot.joint_index("turn"), robot.joint_index("slide")
    bound = motion_bounds(robot)
    assert bound[turn] == pytest.approx(0.2 + 0.5 + 0.1, abs=1e-5)
    assert bound[slide] == 1.0
    far = motion_bounds(robot, np.array([-3.0, -np.inf]), np.array([3.0, np.inf]))
    assert far[turn] == np.inf
    hulls = [Hull(2, np.array([[0.3, 0.0, 0.0]]), 0.0), Hull(2, np.full((1, 3), np.inf), 0.0)]
    assert motion_bounds_of(robot, hulls)[:, 0] == pytest.approx([1.0, np.inf], abs=1e-6)


def test_a_curve_stays_in_its_hull():
    rng = np.random.default_rng(4)
    points = PEPPER.posture("Stand") + rng.uniform(-0.1, 0.1, (6, PEPPER.n))
    spline = as_cubic_path(PEPPER, np.clip(points, PEPPER.lower_limits + 0.05, PEPPER.upper_limits - 0.05))
    low, high = hull_of(spline.breaks, spline.coefficients)
    for i, h in enumerate(np.diff(spline.breaks)):
        states = spline.at(np.full(50, i), np.linspace(0, h, 50))
        assert (states >= low - 1e-12).all()
        assert (states <= high + 1e-12).all()


def test_the_same_source_runs_interpreted():
    from pepper_kin.core import motion_bounds as core

    tree = motion_tree(PEPPER)
    compiled = np.empty((tree.carriers.size, tree.parents.size))
    interpreted = np.empty_like(compiled)
    ends = np.array(PEPPER.lower_limits), np.array(PEPPER.upper_limits)
    core.body_motion_bounds(tree, *ends, compiled)
    assert isinstance(core.body_motion_bounds, CompiledFunction)
    core.body_motion_bounds.python(tree, *ends, interpreted)
    np.testing.assert_allclose(interpreted, compiled, rtol=1e-12)
