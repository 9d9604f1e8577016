"""Arguments that are one number take numbers alone: no truth values, texts, lists or endless integers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import model
from pepper_kin.collision import CollisionChecker, PointCloud
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin import Push

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
WRONG = (True, np.True_, "1", b"1", [0.5], {}, 1j, float("nan"), -1, 10**5000)

CALLS: dict[str, Callable[[Any], object]] = {
    "sphere": model.Sphere,
    "cylinder": lambda x: model.Cylinder(1.0, x),
    "capsule": lambda x: model.Capsule(x, 1.0),
    "box": lambda x: model.Box((1.0, x, 1.0)),
    "wheels": lambda x: model.Wheels(x, 1.0, 0.3),
    "mesh scale": lambda x: pk.load_pepper(meshes=".", mesh_scale=x),
    "velocity limits": lambda x: PEPPER.with_limits(velocity={"HeadYaw": x}),
    "masses": lambda x: PEPPER.with_masses({"Head": x}),
    "acceleration limits": lambda x: pk.load_robot(PEPPER.urdf, acceleration_limits={"HeadYaw": x}),
    "cloud": lambda x: PointCloud(np.zeros((1, 3)), x),
    "margin": lambda x: CollisionChecker(PEPPER, pk.Scene(), margin=x if x != -1 else "far"),
    "push": lambda x: Push.checked(PEPPER, "Head", [1, 0, 0], None, 0.0, x),
    "overshoot": lambda x: pk.Trajectory.from_positions(PEPPER, [0, 1], [STAND, STAND], overshoot=x),
    "plan's margin": lambda x: pk.plan(PEPPER, STAND, STAND, margin=x),
}


def test_what_is_not_one_number_in_range_is_refused() -> None:
    for call in CALLS:
        for value in WRONG:
            with pytest.raises(InvalidValueError, match=r"(?s).+: got .*, expected .+") as caught:
                CALLS[call](value)
            assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    "value", [1, 1.0, np.float32(1.0), np.int8(1), np.array(1.0)], ids=lambda v: type(v).__name__
)
def test_numbers_of_every_type_are_taken(value: Any) -> None:
    assert model.Sphere(value).radius == 1.0
    assert type(model.Sphere(value).radius) is float
    assert (
        PEPPER.with_limits(velocity={"HeadYaw": value}).velocity_limits[PEPPER.joint_index("HeadYaw")] == 1.0
    )
