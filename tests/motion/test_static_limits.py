"""Postures that can be held with a load: against Pinocchio with the load as a body, and against `retime`."""

import importlib.metadata

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError
from pepper_kin.model.requirements import HOLDING_SHARE, ROOM_TO_MOVE
from pepper_kin.motion import PlanStatus, ValidationStatus, interpolate_path, simplify_path, validate
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.static_limits import static_limits

PEPPER = pk.load_pepper().with_requirements("limits")
STAND = PEPPER.posture("Stand")
TABLE = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
HAND = "LArm_effector"
TRIANGLE = np.array([[0.09, 0.155], [-0.17, 0.0], [0.09, -0.155]])  # where the wheels touch the floor [m]


def random_postures(count: int, seed: int = 0, pepper=PEPPER) -> np.ndarray:
    """Return postures of all joints."""
    low, high = np.maximum(pepper.lower_limits, -3.0), np.minimum(pepper.upper_limits, 3.0)
    return np.random.default_rng(seed).uniform(low, high, (count, pepper.n))


def oracle(q: np.ndarray, mass: float, pepper=PEPPER) -> tuple[np.ndarray, np.ndarray]:
    """Return torques (m, n), and how far inside the triangle (m,), with the load as a body of Pinocchio's."""
    model = pepper.inner_model.copy()
    frame = model.frames[pepper.frame_id(HAND)]
    model.appendBodyToJoint(
        frame.parentJoint, pinocchio.Inertia(mass, np.zeros(3), np.zeros((3, 3))), frame.placement
    )
    data, torques, inside = model.createData(), [], []
    still = pepper.inner_model.inertias[0]
    edges = np.roll(TRIANGLE, -1, axis=0) - TRIANGLE
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    for state in q:
        full = np.asarray(pepper.to_full(state))
        torques.append(np.array(pinocchio.computeGeneralizedGravity(model, data, full)) @ pepper.full_map)
        pinocchio.centerOfMass(model, data, full)
        moving = sum(inertia.mass for inertia in list(model.inertias)[1:])
        center = (moving * data.com[0] + still.mass * still.lever) / (moving + still.mass)
        inside.append(((center[:2] - TRIANGLE) * inward).sum(axis=1).min())
    return np.array(torques), np.array(inside)


@pytest.mark.parametrize("mass", [0.3, 1.0])
def test_postures_are_held_as_pinocchio_says_of_a_robot_with_the_load_as_a_body(mass):
    q, statics = random_postures(600), static_limits(PEPPER, 0.03, {"left": mass})
    torque, inside = oracle(q, mass)
    use = np.abs(torque) / (HOLDING_SHARE * PEPPER.effort_limits)
    slack = inside - 0.03 - ROOM_TO_MOVE
    held = (use <= 1.0).all(axis=1) & (slack >= 0.0)
    assert 50 < held.sum() < 550
    np.testing.assert_array_equal(statics.hold(q), held)
    np.testing.assert_allclose([statics.torque(x) for x in q[:20]], torque[:20], atol=1e-9)
    np.testing.assert_allclose([statics.distance_inside(x) for x in q[:20]], inside[:20], atol=1e-9)


@pytest.mark.parametrize("asked", [(None, None), (0.05, None), (None, 0.8), (0.02, 0.5)])
def test_edges_are_held_as_their_states_are(asked):
    balance, mass = asked
    statics = static_limits(PEPPER, balance, None if mass is None else {"left": mass, "right": 0.1})
    free = np.array([PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")])
    checks = Checks(PEPPER, None, statics)
    validity = checks.validity(STAND, free, (0.0, 0.0))
    q = np.tile(STAND, (400, 1))
    q[:, free] = random_postures(400, 1)[:, free]
    np.testing.assert_array_equal(validity(q[:, free]), checks.free(q) & statics.hold(q))
    assert 20 < validity(q[:, free]).sum() < 380


def test_a_base_that_moves_carries_its_triangle_along():
    planar = pk.load_pepper(base="planar")
    statics, there = static_limits(planar, 0.03, {"left": 1.0}), random_postures(300, 2, planar)
    here = there.copy()
    here[:, [planar.joint_index(name) for name in ("BaseX", "BaseY", "BaseYaw")]] = 0.0
    held = statics.hold(here)
    np.testing.assert_array_equal(statics.hold(there), held)
    assert 20 < held.sum() < 280
    for q in there[:40]:
        joint = statics.weakest(q)
        assert (joint is None and not statics.tips(q)) == bool(statics.hold(q[None])[0])


def test_half_a_step_uses_up_no_more_than_what_is_kept_unused():
    for robot, balance, payload in [
        ("pepper", 0.02, {"left": 0.5}),
        ("pepper", None, None),
        ("panda", None, None),
    ]:
        pepper = PEPPER if robot == "pepper" else _panda()
        statics, reach = static_limits(pepper, balance, payload), motion_bounds(pepper)
        assert statics.step > (
            0.02 if robot == "panda" else 0.0
        )  # a robot that is strong is asked less often
        rng, q = np.random.default_rng(3), random_postures(300, 3, pepper)
        ways = rng.normal(size=q.shape) * (rng.random(q.shape) < 0.3)
        ways *= statics.step / 2 / np.maximum(np.abs(ways) @ reach, 1e-9)[:, None]
        spare = (1 - HOLDING_SHARE) * pepper.effort_limits
        for x, way in zip(q, ways, strict=True):
            assert (np.abs(statics.torque(x + way) - statics.torque(x)) <= spare).all()
            if balance is not None:
                assert abs(statics.distance_inside(x + way) - statics.distance_inside(x)) <= ROOM_TO_MOVE / 2


def _panda() -> pk.PepperModel:
    """Return a robot that can hold far more than itself."""
    package = importlib.metadata.distribution("example-robot-data")
    found = [
        file for file in package.files or () if str(file).endswith("robots/panda_description/urdf/panda.urdf")
    ]
    return pk.load_robot(package.locate_file(found[0]))


def _problems(count: int, seed: int):
    """Yield starts and goals of all kinds that can be held with a load."""
    rng, low, high = np.random.default_rng(seed), PEPPER.lower_limits, PEPPER.upper_limits
    statics = static_limits(PEPPER, 0.02, {"left": 0.8})
    free = Checks(PEPPER, TABLE)
    for k in range(count):
        if k % 2:
            yield STAND, [pk.ik.HandPosition("left", rng.uniform([0.1, 0.0, 0.7], [0.45, 0.4, 1.2]))]
            continue
        q = rng.uniform(low, high, (3000, PEPPER.n))
        q = q[statics.hold(q)]
        yield q[free.free(q)][:2]


@pytest.mark.thorough
def test_retime_never_refuses_what_was_planned_with_a_load():
    solved, carried = 0, {"payload": {"left": 0.8}, "balance": 0.02}
    for number, (start, goal) in enumerate(_problems(16, 0)):
        plan = pk.plan(PEPPER, start, goal, TABLE, seed=number, **carried)
        if plan.success:
            solved += 1
            certificate = pk.retime(PEPPER, plan, **carried).check(PEPPER, scene=TABLE, **carried)
            assert certificate.success, certificate.report()
    assert solved > 9


def test_without_the_load_the_same_problems_are_refused():
    refused, carried = 0, {"payload": {"left": 0.8}, "balance": 0.02}
    for number, (start, goal) in enumerate(_problems(30, 0)):
        plan = pk.plan(PEPPER, start, goal, TABLE, seed=number)
        try:
            refused += plan.success and pk.retime(PEPPER, plan, **carried) is None
        except InfeasibleError:
            refused += 1
    assert refused >= 2


def test_a_start_that_is_too_heavy_names_joint_torque_load_and_limit():
    start = PEPPER.joint_vector({"LShoulderRoll": 1.0, "LElbowRoll": -0.1})
    assert pk.plan(PEPPER, start, STAND).success
    plan = pk.plan(PEPPER, start, STAND, payload={"left": 1.5})
    torque = oracle(start[None], 1.5)[0][0]
    joint = int(np.argmax(np.abs(torque) / PEPPER.effort_limits))
    assert plan.status is PlanStatus.START_TORQUE_LIMIT
    assert f"{abs(torque[joint]):.2f} N m at {PEPPER.joint_names[joint]}" in plan.message
    assert "with 1.5 kg at LArm_effector" in plan.message
    assert f"{PEPPER.effort_limits[joint]:.2f} N m it has" in plan.message


def test_ends_that_tip_over_say_how_far_they_are_from_the_edge():
    leaning = PEPPER.joint_vector({"HipPitch": -0.5, "LShoulderPitch": 0.8, "RShoulderPitch": 0.8})
    inside = oracle(leaning[None], 1e-9)[1][0]
    asked = inside + 0.01
    for start, goal, status, what in (
        (leaning, STAND, PlanStatus.START_TIPS_OVER, "start"),
        (STAND, leaning, PlanStatus.GOAL_TIPS_OVER, "goal"),
    ):
        assert pk.plan(PEPPER, start, goal).success
        plan = pk.plan(PEPPER, start, goal, balance=asked)
        assert plan.status is status
        assert f"The {what} has the center of mass {1000 * inside:.1f} mm inside" in plan.message
        assert f"asks for {1000 * asked:.1f} mm" in plan.message
        assert "center of mass" in plan.advice
        assert "wheels" in plan.advice


def test_goals_that_cannot_be_held_are_dropped_for_one_that_can():
    heavy = PEPPER.joint_vector({"LShoulderRoll": 1.0, "LElbowRoll": -0.1})
    light = PEPPER.joint_vector({"RShoulderPitch": 1.2})
    plan = pk.plan(PEPPER, STAND, np.array([heavy, light]), payload={"left": 1.0})
    assert plan.success
    np.testing.assert_allclose(plan.goal, light)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"balance": -0.01}, InvalidValueError, "balance"),
        ({"balance": True}, InvalidValueError, "balance"),
        ({"payload": {"left": 0.0}}, InvalidValueError, "payload at left"),
        ({"payload": {"foot": 1.0}}, UnknownNameError, "foot"),
        ({"payload": 1.0}, InvalidValueError, "mapping"),
    ],
)
def test_limits_are_refused_in_the_words_of_retime(options, error, words):
    for call in (lambda: pk.plan(PEPPER, STAND, STAND, **options),
                 lambda: pk.retime(PEPPER, np.array([STAND, STAND + 0.1]), **options)):  # fmt: skip
        with pytest.raises(error, match=words):
            call()


def test_legs_and_batches_carry_the_load_too():
    from pepper_kin.motion import Leg, plan_legs

    carried = {"payload": {"left": 1.0}}
    heavy = PEPPER.joint_vector({"LShoulderRoll": 1.0, "LElbowRoll": -0.1})
    assert plan_legs(PEPPER, STAND, [Leg(heavy)], **carried).status is PlanStatus.GOAL_TORQUE_LIMIT
    one = pk.PlanProblem(PEPPER, STAND, heavy, **carried)
    assert one.solve().status is PlanStatus.GOAL_TORQUE_LIMIT


def straight(ends: np.ndarray, count: int) -> np.ndarray:
    """Return states on the edge between two postures."""
    return ends[0] + (ends[1] - ends[0]) * np.linspace(0.0, 1.0, count)[:, None]


def test_validate_finds_the_state_at_which_a_load_becomes_too_heavy():
    ends = np.array([STAND, PEPPER.joint_vector({"LShoulderRoll": 1.2, "LElbowRoll": -0.1})])
    assert validate(PEPPER, ends).success
    found = validate(PEPPER, ends, payload={"left": 1.0})
    use = np.abs(oracle(straight(ends, 2001), 1.0)[0]) / PEPPER.effort_limits
    first = int(np.argmax(use.max(axis=1) > HOLDING_SHARE))
    assert first > 0
    assert found.status is ValidationStatus.STATIC_TORQUE_LIMIT
    assert found.place == pytest.approx(first / 2000, abs=2e-3)
    assert found.joint == PEPPER.joint_names[int(use[first].argmax())]
    assert "with 1 kg at LArm_effector" in found.message


def test_validate_finds_the_state_that_tips_over():
    ends = np.array(
        [STAND, PEPPER.joint_vector({"HipPitch": -0.4, "LShoulderPitch": 0.8, "RShoulderPitch": 0.8})]
    )
    inside = oracle(straight(ends, 2001), 0.4)[1]
    asked = float(inside[0] + inside[-1]) / 2
    found = validate(PEPPER, ends, balance=asked, payload={"left": 0.4})
    assert found.status is ValidationStatus.TIPS_OVER
    assert found.place == pytest.approx(np.argmax(inside < asked + ROOM_TO_MOVE / 2) / 2000, abs=2e-3)
    assert "center of mass with 0.4 kg at LArm_effector" in found.message
    assert "2 mm to move with" in found.message
    assert "Keep the center of mass nearer" in found.advice
    assert validate(PEPPER, ends, balance=float(inside.min()) - ROOM_TO_MOVE, payload={"left": 0.4}).success


def test_validate_holds_motions_against_torque_and_balance_with_the_load():
    ends = np.array(
        [STAND, PEPPER.joint_vector({"LShoulderPitch": 0.8, "LElbowRoll": -0.3, "HipPitch": -0.1})]
    )
    carried = {"payload": {"left": 0.3}, "balance": 0.02}
    motion = pk.retime(PEPPER, ends, **carried)
    assert validate(PEPPER, motion, **carried).success
    heavier = validate(PEPPER, motion, payload={"left": 3.0})
    assert heavier.status is ValidationStatus.TORQUE_LIMIT
    state = motion(heavier.place)
    model = PEPPER.inner_model.copy()
    frame = model.frames[PEPPER.frame_id(HAND)]
    model.appendBodyToJoint(
        frame.parentJoint, pinocchio.Inertia(3.0, np.zeros(3), np.zeros((3, 3))), frame.placement
    )
    full = [
        PEPPER.to_full(state.position),
        *(PEPPER.full_map @ x for x in (state.velocity, state.acceleration)),
    ]
    torque = pinocchio.rnea(model, model.createData(), *full) @ PEPPER.full_map
    joint = PEPPER.joint_index(heavier.joint)
    assert abs(torque[joint]) > PEPPER.effort_limits[joint]
    assert f"{torque[joint]:.6g} N m" in heavier.message
    certificate = motion.check(PEPPER, payload={"left": 0.3})
    stricter = validate(PEPPER, motion, payload={"left": 0.3}, balance=certificate.balance.value + 0.005)
    assert stricter.status is ValidationStatus.TIPS_OVER
    assert "the zero-moment point with 0.3 kg at LArm_effector" in stricter.message


def test_retime_never_refuses_what_was_made_shorter_with_a_load():
    rng, carried, without = np.random.default_rng(5), {"payload": {"left": 0.8}, "balance": 0.02}, 0
    solved = 0
    for number, (start, goal) in enumerate(_problems(12, 3)):
        plan = pk.plan(PEPPER, start, goal, TABLE, seed=number, **carried)
        if not plan.success or len(plan.path) < 3:
            continue
        way = interpolate_path(plan, count=10)
        way[1:-1] += rng.normal(0.0, 0.03, (8, PEPPER.n))
        way = np.clip(way, PEPPER.lower_limits, PEPPER.upper_limits)
        loaded, free = (simplify_path(PEPPER, way, TABLE, **options) for options in (carried, {}))
        for found in (loaded, simplify_path(PEPPER, plan, TABLE, **carried)):
            if found.success:
                solved += 1
                certificate = pk.retime(PEPPER, found, **carried).check(PEPPER, scene=TABLE, **carried)
                assert certificate.success, certificate.report()
                assert validate(PEPPER, found, TABLE, **carried).success
        without += free.success and not validate(PEPPER, free, TABLE, **carried).success
    assert solved > 6
    assert without > 0


def test_path_tools_refuse_loads_in_the_words_of_retime():
    points = np.array([STAND, STAND + 0.01])
    for tool in (validate, simplify_path):
        with pytest.raises(InvalidValueError, match="balance: got -1"):
            tool(PEPPER, points, balance=-1.0)
        with pytest.raises(UnknownNameError, match="foot"):
            tool(PEPPER, points, payload={"foot": 1.0})
        heavy = tool(
            PEPPER, np.array([STAND, PEPPER.joint_vector({"LShoulderRoll": 1.0})]), payload={"left": 2.0}
        )
        assert "with 2 kg at LArm_effector" in heavy.message
