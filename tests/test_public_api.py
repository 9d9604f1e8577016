"""The public names: one path and one meaning each, values that stay as they are."""

import dataclasses
import importlib
import inspect
from collections import defaultdict
from collections.abc import Mapping
from enum import Enum

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.paper import GESTURES, paper_gesture
from pepper_kin.status import ResultStatus

WITHIN = ("twin.world", "twin.sensors", "twin.base", "viewer.server")
PACKAGES = (*(name for name in pk.__all__ if inspect.ismodule(getattr(pk, name))), *WITHIN)
SHORT = [name for name in pk.__all__ if not inspect.ismodule(getattr(pk, name))]
"""Names that can be had from the package itself, too."""


def module_of(name):
    return importlib.import_module(f"pepper_kin.{name}")


def public():
    """Every public symbol: package, name, value."""
    for place in PACKAGES:
        for name in module_of(place).__all__:
            yield place, name, getattr(module_of(place), name)


def callables():
    """Every public function, class and method with a signature of its own: its path and parameters."""
    for place, name, value in public():
        if inspect.isclass(value) and not issubclass(value, Enum):
            for key, member in vars(value).items():
                function = getattr(member, "__func__", member)
                if inspect.isfunction(function) and (key == "__init__" or not key.startswith("_")):
                    parameters = list(inspect.signature(function).parameters.values())
                    yield (
                        f"{place}.{name}.{key}",
                        [p for p in parameters if p.name not in ("self", "cls")],
                    )
        elif inspect.isfunction(value):
            yield f"{place}.{name}", list(inspect.signature(value).parameters.values())


def test_each_symbol_has_one_path_and_each_name_one_meaning():
    """Only `symbolic` uses names again: its functions are the expressions of the quantities of that name."""
    places = defaultdict(set)
    for place, name, _ in public():
        if place != "symbolic":
            places[name].add(place)
    assert not {name: where for name, where in places.items() if len(where) > 1}
    quantities = {*pk.kinematics.__all__, *pk.dynamics.__all__}
    assert set(pk.symbolic.__all__) - quantities == {"QUANTITIES", "function"}


def test_a_symbol_is_found_in_no_other_package():
    """Where a package imports what it needs from another, that is not a second path to it."""
    homes = {
        id(value): place
        for place, _, value in public()
        if inspect.isclass(value) or inspect.isfunction(value)
    }
    for place in PACKAGES:
        module = module_of(place)
        for name in dir(module):
            value = getattr(module, name)
            if not name.startswith("_") and homes.get(id(value), place) != place:
                pytest.fail(f"{place}.{name} is {homes[id(value)]}.{name}")


REACHED = """
import sys
for place in sys.argv[1:]:
    for name in [name for name in sys.modules if name.partition(".")[0] == "pepper_kin"]:
        del sys.modules[name]
    import pepper_kin
    assert eval(f"pepper_kin.{place}") is sys.modules[f"pepper_kin.{place}"], place
"""


def test_packages_are_reached_by_attribute(child):
    child(REACHED, *PACKAGES)


def test_short_names_are_those_of_the_packages():
    values = {id(value) for _, _, value in public()}
    for name in SHORT:
        assert id(getattr(pk, name)) in values, name
        assert name in pk.__doc__


def test_help_begins_with_a_list_of_all_names_that_fits_on_a_screen():
    for module in (pk, *map(module_of, PACKAGES)):
        lines = module.__doc__.splitlines()
        assert len(lines) <= 50, module
        assert max(map(len, lines)) <= 112, module
        assert not [name for name in module.__all__ if name not in module.__doc__], module


def test_the_robot_comes_first_or_by_name():
    for path, parameters in callables():
        for place, parameter in enumerate(parameters):
            if parameter.name == "pepper":
                assert place == 0 or parameter.kind is inspect.Parameter.KEYWORD_ONLY, path


def test_a_scene_of_none_means_the_robot_alone_everywhere():
    """A scene is left out or a Scene; what may leave collisions out says so by `collisions`."""
    for path, parameters in callables():
        by_name = {parameter.name: parameter for parameter in parameters}
        if "scene" in by_name and "set_scene" not in path and "add_scene" not in path:
            assert by_name["scene"].default in (None, inspect.Parameter.empty), path
        if "collisions" in by_name:
            assert by_name["collisions"].default is True, path
            assert "scene" in by_name, path


def test_statuses_have_one_base_and_give_advice():
    for place, name, value in public():
        if inspect.isclass(value) and issubclass(value, Enum) and value is not ResultStatus:
            if not name.endswith("Status"):
                continue
            assert issubclass(value, ResultStatus), f"{place}.{name}"
            for status in value:
                assert isinstance(status.value, str)
                assert value(status.value) is status
                assert status.advice.endswith("."), status


def test_what_saves_takes_the_path_last():
    """Options come behind it by name only."""
    visited = 0
    for path, parameters in callables():
        name = path.rsplit(".", 1)[-1]
        assert not name.startswith("write"), path
        if not name.startswith("save"):
            continue
        visited += 1
        operands = [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
        place = next(k for k, operand in enumerate(operands) if operand.endswith(("path", "folder")))
        assert place == len(operands) - 1 or operands[place + 1 :] in (["video_path"], ["motion"]), path
    assert visited > 10


def arrays_in(get, path, visited):
    """Yield every array within a public value: the way to it, and what gets it anew."""
    value = get()
    if id(value) in visited:
        return
    visited[id(value)] = value
    if isinstance(value, np.ndarray):
        yield path, get
    elif isinstance(value, tuple | list):
        for k in range(len(value)):
            yield from arrays_in(lambda k=k: get()[k], f"{path}[{k}]", visited)
    elif isinstance(value, Mapping):
        for key in value:
            yield from arrays_in(lambda key=key: get()[key], f"{path}[{key!r}]", visited)
    elif type(value).__module__.startswith(("pepper_kin", "planners")) and not isinstance(value, Enum):
        for name in dir(value):
            if not name.startswith("_") and name not in OTHERS and not callable(getattr(value, name)):
                yield from arrays_in(lambda name=name: getattr(value, name), f"{path}.{name}", visited)


OTHERS = {
    "inner_model", "pinocchio_model", "pinocchio_data", "moving_center", "dynamics_model", "document", "kept",
}  # fmt: skip
"""Pinocchio's own objects and views of them, which a user may change on purpose, XML, and memories."""


def values():
    """Public values with arrays, by what makes them."""
    pepper = pk.load_pepper()
    stand, hand = pepper.posture("Stand"), pk.ik.HandPosition("left", (0.3, 0.25, 0.9))
    raised = pepper.joint_vector({"LShoulderPitch": 0.6, "LElbowRoll": -0.6}, rest=stand)
    cloud = np.random.default_rng(0).uniform(1, 2, (20, 3))
    corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    scene = (
        pk.Scene()
        .add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
        .add_point_cloud("cloud", cloud, 0.01)
        .add_convex_mesh("wedge", corners, position=(2, 2, 2))
    )
    plan = pk.plan(pepper, stand, [hand], scene)
    trajectory = pk.retime(pepper, plan)
    run = pk.Twin(pepper).execute(trajectory)
    return {
        "model": pepper,
        "scene": scene,
        "tasks": [hand, pk.ik.HandPose("left", np.eye(4)), pk.ik.LookAt((1, 0, 1))],
        "solve": pk.ik.solve(pepper, hand),
        "solve_batch": pk.ik.solve_batch(
            pepper, pk.ik.HandPosition("left", np.array([(0.3, 0.25, 0.9)] * 2))
        ),
        "solutions": pk.ik.solutions(pepper, hand, count=2, starts=4),
        "plan": plan,
        "trajectory": trajectory,
        "samples": trajectory.sample(0.1),
        "check": trajectory.check(pepper, jerk="moderate"),
        "active_limits": trajectory.active_limits(pepper),
        "phase_plane": pk.trajectory.phase_plane(pepper, trajectory),
        "online": pk.trajectory.OnlineMotion(pepper, stand).state,
        "near_pairs": pk.collision.near_pairs(pepper, stand, 0.1, scene),
        "contacts": pk.collision.contacts(pepper, stand, scene, within=0.2),
        "closest_pair": pk.collision.closest_pair(pepper, stand, scene),
        "reach_map": pk.kinematics.reach_map(pepper, "LArm_effector", samples=2000),
        "named_axes": pk.kinematics.named_axes(pepper),
        "run": run,
        "state": pk.Twin(pepper).state,
        "batch run": pk.TwinBatch(pepper, 2).execute(trajectory),
        "actuators": pk.twin.actuator_parameters(pepper),
        "push": pk.Twin(pepper).push("LArm_effector", (1, 0, 0)),
        "gesture": paper_gesture(GESTURES[0]),
        "place_base": pk.base_placement.place_base(pepper, hand, candidates=4),
        "placement_map": pk.base_placement.placement_map(pepper, hand, center=(0, 0), size=0.2, headings=1),
        "servo": pk.servo.Servo(pepper, stand).step(),
        "differential_step": pk.servo.differential_step(pepper, stand, 0 * stand, 0.01, hand),
        "sensors": pk.twin.sensors.SensorSuite(pepper).read(0.0, stand),
        "base": pk.twin.base.pepper_base(),
        "joint motion": pk.viewer.JointMotion(np.array([0.0, 1.0]), np.stack([stand, raised])),
        "marker": pk.viewer.marker("a", (0, 0, 0)),
        "viewpoint": pk.viewer.Viewpoint((1, 1, 1), (0, 0, 0)),
        "path": pk.planners.Path(np.zeros((2, 3))),
        "car_curve": pk.planners.car_curve((0, 0, 0), (1, 1, 0), 0.3),
        "cartesian_path": pk.motion.cartesian_path(
            pepper, raised, "left", pk.motion.Line((0, 0, 0.02), relative=True)
        ),
        "arc": pk.motion.Arc((0, 0, 1), (0, 0, 1), 1.0),
    }


def test_frozen_values_stay_frozen():
    """What a value keeps is read-only; what it computes when asked may be written to, to no effect."""
    found, visited = 0, {}
    for name, value in values().items():
        before = found
        for path, get in arrays_in(lambda value=value: value, name, visited):
            found += 1
            array = get()
            if array.flags.writeable:
                kept = array.copy()
                array[...] = np.logical_not(array) if array.dtype == bool else array + 1
                np.testing.assert_array_equal(get(), kept, err_msg=path)
        assert found > before, f"no array in {name}"
        if dataclasses.is_dataclass(value):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(value, dataclasses.fields(value)[0].name, None)
    assert found > 400
