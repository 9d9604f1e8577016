"""Base placement: a place from which the left hand reaches both a cup and a shelf."""

import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(2.0, 0.0, 0.70))
cup, shelf = np.array([1.80, 0.20, 0.85]), np.array([1.75, 0.45, 1.10])

# Each list is met by one configuration; all of them from the same place.
tasks = [
    [pk.ik.HandPosition("left", cup), pk.ik.LookAt(cup)],
    [pk.ik.HandPosition("left", shelf)],
]
result = pk.base_placement.place_base(pepper, tasks, scene=scene, seed=0)
print(result.report())

# The configurations are those of the robot at that place: carry the hands back into the world.
place = result.best
for q, point in zip(place.q, (cup, shelf), strict=True):
    transform_hand_to_base = pk.kinematics.frame_pose(pepper, q, "LArm_effector")
    hand = (place.transform_base_to_world @ transform_hand_to_base)[:3, 3]
    print(f"hand at {hand.round(3)}, {1000 * np.linalg.norm(hand - point):.2f} mm from {point}")
    assert np.linalg.norm(hand - point) < 1e-3

assert result.success
assert place.terms.clearance > 0
