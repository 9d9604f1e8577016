"""Messages: bad values cut short, names suggested, and advice that names only options of its function."""

import ast
import enum
import importlib
import inspect
import pickle
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.exceptions import (
    InfeasibleError,
    InvalidValueError,
    LimitError,
    UnknownNameError,
    beside_limits,
    did_you_mean,
    shortened,
)
from pepper_kin.naoqi import NaoqiError, Robot, RobotConnectionError

ROOT = Path(__file__).parents[1]
OPTIONS = {"balance", "candidates", "margin", "payload", "restarts", "seed", "starts", "timeout"}
"""Words of advice that are options wherever they stand; words with an underscore are always taken for one."""


def test_a_long_value_is_cut_at_80_characters():
    assert shortened("x" * 80) == "x" * 80
    assert shortened("x" * 81) == "x" * 77 + "..."
    with pytest.raises(InvalidValueError) as raised:
        pk.load_pepper().joint_vector("z" * 500)
    error = InvalidValueError("q", np.arange(1000.0), "finite numbers")
    assert len(str(error)) == len("q: got , expected finite numbers") + 80
    assert "\n" not in str(error)
    assert len(str(raised.value).partition(", expected")[0]) < 130


def test_a_value_beside_its_limit_reads_as_what_it_is():
    assert beside_limits(0.43978, 0.4398) == ["0.4398", "0.4398"]
    assert beside_limits(2.085669, -2.08567, 2.085668, outside=True) == ["2.085669", "-2.08567", "2.085668"]
    rng = np.random.default_rng(0)
    limits = 10.0 ** rng.uniform(-3, 3, 1000)
    for limit, value in zip(limits, limits * (1.0 + 10.0 ** rng.uniform(-12, 0, 1000)), strict=True):
        text, most = map(float, beside_limits(value, limit, outside=True))
        assert text > most
        assert float.__le__(*map(float, beside_limits(limit, value)))
    with pytest.raises(LimitError, match=r"2\.0856691 rad is outside \[-2\.08567, 2\.085669\]"):
        raise LimitError("start", "HeadYaw", 2.0856691, -2.08567, 2.085669)


def test_the_name_most_like_a_wrong_one_is_suggested():
    for look_up, message in [
        (
            lambda p: p.joint_index("HeadYow"),
            "unknown joint 'HeadYow' (did you mean 'HeadYaw'?); available: ",
        ),
        (lambda p: p.joint_index("headyaw"), "unknown joint 'headyaw' (did you mean 'HeadYaw'?)"),
        (lambda p: p.joint_group("leftarm"), "(did you mean 'left_arm'?)"),
        (lambda p: p.posture("Stnd"), "unknown posture 'Stnd' (did you mean 'Stand'?)"),
        (lambda p: p.resolve_joints(["right_amr"]), "(did you mean 'right_arm'?)"),
        (lambda p: pk.motion.gesture(p, "wavw"), "unknown gesture 'wavw' (did you mean 'wave'?)"),
        (lambda p: pk.kinematics.frame_pose(p, p.posture("Stand"), "LArm_efector"), "mean 'LArm_effector'?"),
        (lambda p: pk.ik.HandPosition("lefft", [0, 0, 1]), "unknown hand 'lefft' (did you mean 'left'?)"),
        (
            lambda p: pk.plan(p, p.posture("Stand"), p.posture("Crouch"), planner="rrt_conect"),
            "'rrt_connect'",
        ),
    ]:
        with pytest.raises((UnknownNameError, InvalidValueError)) as raised:
            look_up(pk.load_pepper())
        assert message in str(raised.value)


def test_nothing_is_suggested_for_a_name_unlike_all():
    assert did_you_mean("soul", ("body", "camera")) == ""
    assert "did you mean" not in str(UnknownNameError("layer", "soul", ("body", "camera")))


def enums_with_advice():
    found = set()
    for package in (pk, planners):
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if "__main__" in info.name or ".urdf" in info.name:
                continue
            for value in vars(importlib.import_module(info.name)).values():
                if isinstance(value, enum.EnumMeta) and hasattr(value, "advice") and len(value):
                    found.add(value)
    return sorted(found, key=lambda kind: (kind.__module__, kind.__name__))


FUNCTIONS = {
    "pepper_kin.base_placement.result": pk.base_placement.place_base,
    "pepper_kin.ik.result": pk.ik.solve,
    "pepper_kin.motion.cartesian": pk.motion.cartesian_path,
    "pepper_kin.motion.follow_result": pk.motion.follow,
    "pepper_kin.motion.live_motion": pk.motion.LiveMotion,
    "pepper_kin.motion.optimization.minimum_torque": pk.motion.minimum_torque_trajectory,
    "pepper_kin.motion.optimization.optimized": pk.motion.optimize,
    "pepper_kin.motion.plan_result": pk.motion.plan,
    "pepper_kin.motion.retargeting": pk.motion.retarget,
    "pepper_kin.motion.validation": pk.motion.validate,
    "pepper_kin.planners.optimization.descend": planners.optimization.descend,
    "pepper_kin.planners.optimization.general": planners.optimization.minimum_effort,
    "pepper_kin.planners.result": planners.rrt_connect,
    "pepper_kin.servo.state": pk.servo.Servo,
    "pepper_kin.supervision": Robot.follow,
    "pepper_kin.twin.base.tipping": pk.twin.base.simulate_tipping,
    "pepper_kin.twin.run_status": pk.twin.Twin.execute,
}
"""The function whose results carry a status, by the module of the status."""


def test_advice_names_options_that_the_function_has():
    for kind in enums_with_advice():
        function = FUNCTIONS[kind.__module__]
        known = set(inspect.signature(function).parameters)
        if function is planners.rrt_connect:
            known.add("margin")  # of the problem's checker, which the caller has written
        for status in kind:
            text = re.sub(r"[\w.]+\([^)]*\)", "", status.advice)  # other functions, as in "retime()"
            words = set(re.findall(r"[a-z_]+", text))
            named = {word for word in words if "_" in word or word in OPTIONS}
            assert named <= known, f"{status}: {function.__name__} has no {sorted(named - known)}"


CALL = re.compile(r"\b(load_robot|load_pepper|retime|plan|check|optimize|solve)\((\w+)=")


def test_calls_in_messages_name_arguments_that_exist():
    functions = {
        "load_robot": pk.load_robot, "load_pepper": pk.load_pepper, "retime": pk.retime, "plan": pk.plan,
        "check": pk.trajectory.check, "optimize": pk.motion.optimize, "solve": pk.ik.solve,
    }  # fmt: skip
    found = 0
    for path in sorted((ROOT / "pepper_kin").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                for name, argument in CALL.findall(node.value):
                    found += 1
                    assert argument in inspect.signature(functions[name]).parameters, (path, name, argument)
    assert found >= 3


def test_an_orientation_that_is_met_is_said_so():
    pepper = pk.load_pepper()
    stand = pepper.posture("Stand")
    pose = pk.kinematics.frame_pose(pepper, stand, "LArm_effector")
    task = pk.ik.FrameOrientation("LArm_effector", pose[:3, :3])
    assert task.attained(pepper, stand) == "an orientation less than 0.1 deg from its target"
    turned = pk.ik.FrameOrientation("LArm_effector", pk.pose(rpy=[0, 0, 0.1])[:3, :3] @ pose[:3, :3])
    assert turned.attained(pepper, stand).startswith(
        "an orientation (0.0, 0.0, 5.7) deg about the world's axes"
    )


def test_errors_travel_between_processes_with_their_sentence():
    """Errors that are an OSError as well arrived without a word."""
    for error in [
        InvalidValueError("q", 1, "2"),
        UnknownNameError("joint", "Tail", ["HeadYaw"]),
        RobotConnectionError("tcp://robot:9559", "connect: nobody listens"),
        NaoqiError("ALMotion", "wakeUp", "no"),
        LimitError("start", "HeadYaw", 3.0, -2.0, 2.0),
        InfeasibleError("trajectory", "too heavy", "lift less"),
    ]:
        arrived = pickle.loads(pickle.dumps(error))
        assert type(arrived) is type(error)
        assert str(arrived) == str(error) != ""
        assert (arrived.args, vars(arrived)) == (error.args, vars(error))
