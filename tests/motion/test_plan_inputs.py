"""Odd inputs of `plan`: each is refused by name, or planned."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, PepperKinError, UnknownNameError
from pepper_kin.motion import Leg, plan_constrained, plan_costed, plan_legs

PEPPER = pk.load_pepper()
START = PEPPER.posture("Stand")
GOAL = PEPPER.joint_vector({"LShoulderPitch": 0.4, "LShoulderRoll": 0.1, "LElbowRoll": -0.9})
HAND = pk.ik.FramePosition("l_gripper", [0.3, 0.2, 0.9])

NO_NUMBERS = [np.nan, None, "x", [], object(), {}, [[]], START * 1j, list("abc"), np.zeros(PEPPER.n + 1)]


def test_what_is_no_configuration_is_refused_as_start_and_as_goal():
    for value in [*NO_NUMBERS, np.full(PEPPER.n, np.nan), np.zeros((2, 2, PEPPER.n))]:
        with pytest.raises(InvalidValueError, match="start: "):
            pk.plan(PEPPER, value, GOAL)
        with pytest.raises(InvalidValueError, match="goal: "):
            pk.plan(PEPPER, START, value)


def test_no_goal_at_all_is_refused():
    with pytest.raises(InvalidValueError, match="goal: got no configuration, expected one or more"):
        pk.plan(PEPPER, START, np.empty((0, PEPPER.n)))


def test_tasks_and_configurations_do_not_mix():
    with pytest.raises(InvalidValueError, match="tasks: got array"):
        pk.plan(PEPPER, START, [HAND, GOAL])


REFUSED = [
    *(("margin", value) for value in (-1, np.inf, np.nan, None, "1", [0.01], True)),
    *(("least_margin", value) for value in (-1, 0.02, np.nan, None, "1", True)),
    *(("timeout", value) for value in (0, -1, np.inf, np.nan, None, "1", True, [1.0])),
    *(("seed", value) for value in (-1, 1.5, np.nan, None, "1")),
    *(("joints", value) for value in ([], 5)),
    *(("balance", value) for value in (-1, np.nan, np.inf, "a", True)),
    *(("payload", value) for value in ({"left": -1}, {"left": np.nan}, {"left": "a"}, 5, [("left", 1)])),
    *(("planner", value) for value in ("", None, 5, "rrt")),
    *(("gap", value) for value in (-1, np.nan, "a")),
    *(("scene", value) for value in (5, "scene", {}, [])),
    *(("costs", value) for value in ([], 5)),
]


def test_odd_options_are_refused_by_name():
    for name, value in REFUSED:
        options = {"planner": "aorrtc"} if name == "gap" else {}
        with pytest.raises(InvalidValueError, match=rf"^{name}"):
            pk.plan(PEPPER, START, GOAL, **{**options, name: value})


def test_odd_names_and_robots_are_refused():
    for joints in ("", "nope", [1], [None]):
        with pytest.raises(UnknownNameError, match="joint or group"):
            pk.plan(PEPPER, START, GOAL, joints=joints)
    with pytest.raises(UnknownNameError, match="nope"):
        pk.plan(PEPPER, START, GOAL, payload={"nope": 1})
    for robot in (None, "pepper"):
        for make in (pk.plan, plan_costed, plan_constrained):
            with pytest.raises(InvalidValueError, match=r"^pepper: "):
                make(robot, START, GOAL)
        with pytest.raises(InvalidValueError, match=r"^pepper: "):
            plan_legs(robot, START, [Leg(GOAL)])
    with pytest.raises(LimitError, match="goal: "):
        pk.plan(PEPPER, START, PEPPER.upper_limits + 0.1)


def test_nothing_in_place_of_what_a_plan_is_made_from_is_refused_by_name():
    with pytest.raises(InvalidValueError, match=r"^constraints: got None"):
        plan_constrained(PEPPER, START, START, constraints=None)
    with pytest.raises(InvalidValueError, match=r"^costs: got None"):
        plan_costed(PEPPER, START, GOAL, costs=None)
    with pytest.raises(InvalidValueError, match=r"^legs: got \[None\]"):
        plan_legs(PEPPER, START, None)


def test_extreme_options_plan():
    for options in [
        *({"margin": value} for value in (-0.0, 1e-300, 1e3, 1e300)),
        *({"timeout": value} for value in (1e-300, 1e-9, 1e300)),
        *({"seed": value} for value in (True, 2**64 - 1, 2**70, 10**400)),
        {"payload": {}},
        {"scene": pk.Scene()},
    ]:
        assert pk.plan(PEPPER, START, GOAL, **options).success


def test_what_touches_at_the_start_is_named_whatever_the_goal():
    wall = pk.Scene().add_box("wall", (1, 1, 1), (0, 0, 0.5))
    for goal in (GOAL, START, [HAND]):
        plan = pk.plan(PEPPER, START, goal, wall)
        assert plan.status is pk.motion.PlanStatus.START_IN_COLLISION
        assert "wall" in plan.message
    assert issubclass(InvalidValueError, PepperKinError)
