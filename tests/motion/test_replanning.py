"""Planned ways onto which a robot gets in motion: certificates, speeds, refusals."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, LimitError
from pepper_kin.motion import replan


def a_case(pepper, rng):
    """Return a motion, an instant, a goal, and a scene that the states then and there are free of."""
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    while True:
        start, end, goal = rng.uniform(lower, upper, (3, pepper.n))
        plan = pk.plan(pepper, start, end, timeout=1.0)
        if plan.success and not pk.collision.in_collision(pepper, goal).any():
            break
    motion = pk.retime(pepper, plan, torque=False)
    at, scene = float(rng.uniform(0.1, 0.9) * motion.duration), pk.Scene()
    while len(scene.names) < 10:
        place = rng.uniform((0.2, -0.6, 0.5), (0.8, 0.6, 1.3))
        more = scene.add_box(f"box {len(scene.names)}", rng.uniform(0.08, 0.24, 3), place)
        if not pk.collision.in_collision(pepper, np.array([motion(at).position, goal]), more).any():
            scene = more
    return motion, at, goal, scene


def test_ways_among_boxes_keep_all_limits(pepper):
    """The certificate measures distances by coal every millisecond, and none is later than stop and go."""
    rng, ways = np.random.default_rng(3), []
    for _ in range(25):
        motion, at, goal, scene = a_case(pepper, rng)
        try:
            splice = replan(pepper, motion, at, goal, scene, torque=False)
        except InfeasibleError:
            stop = motion.stop(pepper, at, scene=scene, torque=False)
            assert stop.clearance.least <= 0.0
            continue
        ways.append(splice.how)
        found = splice.trajectory
        assert np.allclose(found.end, goal, rtol=0, atol=1e-9)
        assert found.between(0.0, at).is_close(motion.between(0.0, at))
        certificate = found.between(at, found.duration).check(pepper, scene)
        assert set(certificate.failures) <= {"torque", "balance"}, certificate.report()
        if splice.how == "joined":
            inside = np.linspace(at, 0.999 * found.duration, 2000)
            assert np.abs(found(inside).velocity).max(axis=1).min() > 0.0
            stop = motion.stop(pepper, at, torque=False)
            way = pk.plan(pepper, stop.end, goal, scene, timeout=1.0)
            assert found.duration < at + stop.duration + pk.retime(pepper, way, torque=False).duration
    assert ways.count("joined") >= 4
    assert ways.count("after a stop") <= 3


def test_torque_and_balance_are_kept_on_planned_ways(pepper):
    rng, joined = np.random.default_rng(8), 0
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.04 * lower[:3], 0.04 * upper[:3]
    for _ in range(60):
        start, end, goal = rng.uniform(lower, upper, (3, pepper.n))
        try:
            motion = pk.retime(pepper, pk.plan(pepper, start, end, balance=0.0), balance=0.0)
            splice = replan(pepper, motion, motion.duration / 2, goal, balance=0.0)
        except InfeasibleError:
            continue
        joined += splice.how == "joined"
        certificate = splice.trajectory.check(pepper, balance=0.0)
        assert certificate.success, certificate.report()
    assert joined >= 2


def test_what_has_no_way_is_refused(pepper):
    rng = np.random.default_rng(3)
    motion, at, goal, scene = a_case(pepper, rng)
    with pytest.raises(LimitError):
        replan(pepper, motion, at, goal + 10.0, scene)
    inside = pk.kinematics.frame_pose(pepper, goal, "LArm_effector")[:3, 3]
    with pytest.raises(InfeasibleError, match=r"collision: .* and ball"):
        replan(pepper, motion, at, goal, pk.Scene().add_sphere("ball", 0.02, inside))
