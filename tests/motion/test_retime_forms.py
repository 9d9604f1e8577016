"""`retime(pepper, plan)` for every function that makes a plan, and the other forms that it takes."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
GOAL = PEPPER.joint_vector({"HeadYaw": 0.4, "LShoulderPitch": 0.6, "LElbowRoll": -1.0})
UPRIGHT = pk.ik.AxisAlignment("torso", (0, 0, 1), axis=(0, 0, 1), tolerance=0.3)


PLANS = {
    "plan": lambda: pk.plan(PEPPER, STAND, GOAL),
    "plan to tasks": lambda: pk.plan(PEPPER, STAND, [pk.ik.HandPosition("left", (0.4, 0.2, 0.9))]),
    "plan by another planner": lambda: pk.plan(PEPPER, STAND, GOAL, planner="aorrtc", timeout=0.3),
    "plan with constraints": lambda: pk.plan(PEPPER, STAND, GOAL, constraints=[UPRIGHT]),
    "smooth plan": lambda: pk.plan(PEPPER, STAND, GOAL, smooth=True),
    "constrained plan": lambda: pk.motion.plan_constrained(PEPPER, STAND, GOAL, constraints=[UPRIGHT]),
    "costed plan": lambda: pk.motion.plan_costed(PEPPER, STAND, GOAL, costs=[UPRIGHT], timeout=1.0),
    "batch": lambda: pk.plan_batch([pk.PlanProblem(PEPPER, STAND, GOAL)], processes=1).plans[0],
    "simplified path": lambda: pk.motion.simplify_path(PEPPER, [STAND, GOAL]),
    "one leg of several": lambda: pk.motion.plan_legs(PEPPER, STAND, [pk.motion.Leg(GOAL)]).plans[0],
}


@pytest.mark.parametrize("name", PLANS)
def test_every_plan_is_timed_along_exactly_its_curve(name):
    plan = PLANS[name]()
    assert plan.success, plan.report()
    trajectory = pk.retime(PEPPER, plan)
    assert trajectory.check(PEPPER).success
    # SciPy's own reading of the curve, dense: every position of the motion is on it.
    curve = PPoly(np.moveaxis(plan.curve.coefficients, 0, 1)[::-1], plan.curve.breaks)
    s = np.linspace(plan.curve.breaks[0], plan.curve.breaks[-1], 20_001)
    points = curve(s)
    for q in trajectory(np.linspace(0.0, trajectory.duration, 60)).position:
        k = int(np.argmin(((points - q) ** 2).sum(axis=1)))
        near = curve(np.linspace(s[max(k - 1, 0)], s[min(k + 1, s.size - 1)], 2001))
        assert np.sqrt(((near - q) ** 2).sum(axis=1).min()) < 1e-5
    np.testing.assert_allclose(trajectory.start, points[0], atol=1e-9)
    np.testing.assert_allclose(trajectory.end, points[-1], atol=1e-9)
    assert trajectory == pk.retime(PEPPER, plan.curve)


def test_curves_way_points_and_trajectories_of_degree_three():
    plan = pk.plan(PEPPER, STAND, GOAL)
    for path in ([STAND, GOAL], (STAND.tolist(), GOAL.tolist()), np.array([STAND, GOAL]), plan.path):
        np.testing.assert_allclose(pk.retime(PEPPER, path).end, GOAL, atol=1e-9)
    frames = pk.Trajectory.from_keyframes(PEPPER, {0.0: STAND, 3.0: GOAL})
    assert pk.retime(PEPPER, frames).duration < 3.0


def test_what_is_no_path_is_refused_with_what_to_give():
    failed = pk.plan(
        PEPPER, STAND, GOAL, pk.Scene().add_box("box", size=(0.4,) * 3, position=(0.3, 0.2, 1.0))
    )
    with pytest.raises(InfeasibleError, match="planning failed: The start is in collision"):
        pk.retime(PEPPER, failed)
    with pytest.raises(InvalidValueError, match="plan: got a start that equals the goal"):
        pk.retime(PEPPER, pk.plan(PEPPER, STAND, STAND))
    legs = pk.motion.plan_legs(PEPPER, STAND, [pk.motion.Leg(GOAL)])
    with pytest.raises(
        InvalidValueError, match=r"path: got a PlanInLegs, expected a plan, .* their own retime"
    ):
        pk.retime(PEPPER, legs)
    assert legs.retime(PEPPER).duration > 0
    quintic = pk.retime(PEPPER, [STAND, GOAL]).sample(0.05).to_trajectory()
    with pytest.raises(InvalidValueError, match=r"path: got segments of degree 5, .*trajectory.sample"):
        pk.retime(PEPPER, quintic)
    assert pk.retime(PEPPER, quintic.sample(0.05).position).duration > 0
