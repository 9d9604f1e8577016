"""What base placement refuses, by name."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.base_placement import PlacementWeights
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError

PEPPER = pk.load_pepper()
POINT = np.array([2.0, 0.4, 0.9])
LEFT = pk.ik.HandPosition("left", POINT)


def test_misuse_is_named():
    for arguments, error, message in [
        ({"tasks": []}, InvalidValueError, "tasks: got none, expected at least one task"),
        ({"tasks": [[]]}, InvalidValueError, "tasks: got none"),
        ({"tasks": [LEFT, [LEFT]]}, InvalidValueError, "tasks and lists mixed"),
        ({"tasks": "left"}, InvalidValueError, "tasks: got 'left'"),
        ({"tasks": [["left"]]}, InvalidValueError, "tasks: got 'left'"),
        ({"tasks": pk.ik.FramePosition("nose", POINT)}, UnknownNameError, "unknown frame 'nose'"),
        (
            {
                "tasks": [
                    pk.ik.HandPosition("left", np.array([POINT] * 2)),
                    pk.ik.LookAt(np.array([POINT] * 3)),
                ]
            },
            InvalidValueError,
            "left hand: 2, gaze of CameraTop_frame: 3",
        ),
        ({"joints": "tail"}, UnknownNameError, "unknown joint or group 'tail'"),
        ({"stand": (0, 0)}, InvalidValueError, "stand: got shape"),
        ({"stand": (0, np.nan, 0)}, InvalidValueError, "stand: got nan"),
        ({"stand": (5000, 0, 0)}, InvalidValueError, "stand: got .* expected a place within"),
        ({"candidates": 0}, InvalidValueError, "candidates: got 0, expected an integer of at least 1"),
        ({"candidates": [(0, np.inf, 0)]}, InvalidValueError, "candidates: got inf"),
        ({"candidates": [(0, 0)]}, InvalidValueError, "candidates: got shape"),
        ({"keep": 0}, InvalidValueError, "keep: got 0"),
        ({"seed": -1}, InvalidValueError, "seed: got -1"),
        ({"threads": 0}, InvalidValueError, "threads: got 0"),
        ({"scene": "table"}, InvalidValueError, "scene: got 'table'"),
        ({"start": np.full(15, 9.0)}, LimitError, "start: "),
        ({"start": np.zeros((2, 15))}, InvalidValueError, "start: got shape"),
    ]:
        with pytest.raises(error, match=message):
            pk.base_placement.place_base(PEPPER, **{"tasks": LEFT, "candidates": 4, **arguments})


def test_a_task_class_of_ones_own_is_served():
    class Reach(pk.ik.Task):
        frame, label, weight, tolerance, unit, count = "LArm_effector", "hand", 1.0, 0.01, "m", None

        def check(self, pepper):
            pepper.frame_id(self.frame)

        def residual(self, pepper, q):
            return pk.kinematics.frame_pose(pepper, q, self.frame)[:3, 3] - (1.0, 0.5, 0.8)

        def jacobian(self, pepper, q):
            return pk.kinematics.frame_jacobian(pepper, q, self.frame)[:3]

        def size(self, residual):
            return float(np.linalg.norm(residual))

        def shortfall(self, pepper, q):
            return "hand is not there"

        def attained(self, pepper, q):
            return "something"

    assert pk.base_placement.place_base(PEPPER, Reach(), candidates=3, collisions=False).success


def test_misuse_of_weights_and_maps_is_named():
    with pytest.raises(InvalidValueError, match="weight of travel: got -1"):
        PlacementWeights(travel=-1)
    with pytest.raises(InvalidValueError, match="weight of clearance: got nan"):
        PlacementWeights(clearance=float("nan"))
    with pytest.raises(InvalidValueError, match="weights: got all 0"):
        PlacementWeights(0, 0, 0, 0)
    for name, value in (("resolution", 0.0), ("size", np.nan), ("headings", 0), ("center", (0, 0, 0))):
        with pytest.raises(InvalidValueError, match=f"{name}: got"):
            pk.base_placement.placement_map(PEPPER, LEFT, **{"center": (0, 0), name: value})
    with pytest.raises(InvalidValueError, match="ten million"):
        pk.base_placement.placement_map(PEPPER, LEFT, center=(0, 0), resolution=1e-4, collisions=False)
