"""Arrays of frozen values: read-only in pickled and deep copies, too."""

import ast
import copy
import dataclasses
import pickle
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.arrays import read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.files.certified import refuse_unsafe
from pepper_kin.trajectory import Trajectory

COPIES = {
    **{f"pickle {p}": (lambda v, p=p: pickle.loads(pickle.dumps(v, p))) for p in (2, 4, 5)},
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,
}


def inside(value, known):
    """Yield the frozen values of the library that are reached from a value, itself among them."""
    if id(value) in known:
        return
    known[id(value)] = value
    if isinstance(value, Mapping):
        parts = list(value.values())
    elif isinstance(value, (tuple, list)):
        parts = list(value)
    elif type(value).__module__.startswith("pepper_kin"):
        if dataclasses.is_dataclass(value):
            yield value
        fields = getattr(value, "__dict__", {})
        parts = [part for name, part in fields.items() if name != "kept"]  # what packages keep for a robot
    else:
        return
    for part in parts:
        yield from inside(part, known)


def arrays_of(value):
    """Return the arrays of a value's own fields by name, those in tuples among them."""
    found = {}
    for field in dataclasses.fields(value):
        held = getattr(value, field.name)
        for k, part in enumerate(held if type(held) is tuple else (held,)):
            if isinstance(part, np.ndarray):
                found[field.name, k] = part
    return found


@pytest.fixture(scope="module")
def values():
    """Values of most of the public classes that hold arrays."""
    pepper = pk.load_pepper()
    corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.4))
    scene = scene.add_convex_mesh("hull", np.add(corners, 3.0))
    scene = scene.add_mesh("mesh", np.add(corners, 4.0), [[0, 1, 2], [0, 1, 3]])
    scene = scene.add_point_cloud("cloud", np.add(corners, 5.0), 0.01)
    scene = scene.add_sphere("ball", 0.02, (0.3, 0.2, 2.0))
    tasks = [pk.ik.HandPosition("left", (0.38, 0.22, 0.82)), pk.ik.LookAt((1.0, 0.0, 1.0))]
    start, solved = pepper.posture("Stand"), pk.ik.solve(pepper, tasks)
    trajectory = pk.retime(pepper, np.array([start, start + 0.1 * (solved.q - start)]))
    twin = pk.Twin(pepper, timestep=0.001)
    servo = pk.servo.Servo(pepper, start)
    checker = pk.collision.CollisionChecker(pepper, scene)
    held = scene.attach("ball", "LArm_effector", pepper=pepper, q=start)
    return [
        (
            held,
            scene,
            tasks,
            solved,
            trajectory,
            trajectory.sample(0.01),
            trajectory.check(pepper, scene=scene),
        ),
        (twin.execute(trajectory), twin.state, servo.step(), checker.closest_pair(start)),
        (pk.motion.Line((0.3, 0.2, 0.9)), pepper),
    ]


@pytest.fixture(scope="module")
def trajectory(values):
    return values[0][4]


def test_what_is_read_only_is_so_in_every_copy(values):
    examined, writable = set(), set()
    for value in inside(values, {}):
        before = arrays_of(value)
        if (
            ".fast." in type(value).__module__
            or ".symbolic." in type(value).__module__
            or type(value).__name__.startswith("_")
        ):
            continue  # what is kept while something is computed
        if not before or any(array.flags.writeable for array in before.values()):
            continue
        examined.add(type(value).__name__)
        for way, copied in COPIES.items():
            after = arrays_of(copied(value))
            assert after.keys() == before.keys()
            for name, array in after.items():
                if array.flags.writeable:
                    writable.add((type(value).__name__, name[0], way))
                np.testing.assert_array_equal(array, before[name])
                assert array.dtype == before[name].dtype
    assert writable == set()
    assert {"Trajectory", "Samples", "IKResult", "SceneObject", "HandPosition", "Shape"} <= examined, examined


@pytest.mark.thorough
def test_every_class_that_makes_its_arrays_read_only_keeps_them_so():
    """Found in the source: a class that freezes arrays and forgets its copies fails here."""
    classes = {}
    folder = Path(pk.__file__).parent
    for path in folder.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                source = "\n".join(text.splitlines()[node.lineno - 1 : node.end_lineno])
                frozen = any("frozen=True" in ast.unparse(how) for how in node.decorator_list)
                freezes = frozen and ("read_only(" in source or "setflags(write=False)" in source)
                alone = freezes and "__reduce__" not in source
                classes[node.name] = (alone, [ast.unparse(base) for base in node.bases])

    def keeps(name):
        return name == "FrozenArrays" or any(map(keeps, classes.get(name, (False, []))[1]))

    alone = [name for name, (freezes, _) in classes.items() if freezes]
    assert len(alone) > 30
    assert [name for name in alone if not keeps(name)] == []


def test_the_arrays_of_a_trajectory_cannot_be_made_writable(trajectory):
    for value in (trajectory, *(copied(trajectory) for copied in COPIES.values())):
        for array in (value.breaks, value.coefficients):
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0


@pytest.mark.parametrize("shape", [(), (0, 3), (3,), (2, 3, 4)])
@pytest.mark.parametrize("dtype", [float, np.int64, bool])
def test_a_read_only_copy_has_the_values_of_what_it_copies(shape, dtype):
    values = np.asarray(np.random.default_rng(0).normal(size=shape) * 10).astype(dtype)
    copied = read_only(values.T, dtype)
    np.testing.assert_array_equal(copied, values.T)
    assert copied.dtype == dtype
    assert copied.flags.aligned
    assert copied.flags.c_contiguous
    assert not np.shares_memory(copied, values)


def test_a_trajectory_with_a_check_of_its_own_is_refused(trajectory, tmp_path):
    class Lenient(Trajectory):
        def check(self, *args, **options):
            return trajectory.check(pk.load_pepper())

    fast = Lenient(trajectory.joint_names, trajectory.breaks * 1e-3, trajectory.coefficients)
    for unsafe in (
        lambda: refuse_unsafe(fast, None, None, None, False),
        lambda: pk.files.save(fast, tmp_path / "fast.py"),
        lambda: pk.files.save(fast, tmp_path / "fast.yaml"),
    ):
        with pytest.raises(
            InvalidValueError, match="trajectory: got a Lenient, expected a Trajectory itself"
        ):
            unsafe()
    assert not list(tmp_path.iterdir())
