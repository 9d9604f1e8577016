"""A target that is out of reach: the status and report of a failure."""

import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper()
target = np.array([1.0, 0.2, 1.0])
result = pk.ik.solve(pepper, [pk.ik.HandPosition("left", target)])

print(result.status.name)
print(result.report())

palm = pk.kinematics.frame_pose(pepper, result.q, "LArm_effector")[:3, 3]
print(
    "the palm stops at", palm.round(3), "which is", round(float(np.linalg.norm(palm - target)), 3), "m short"
)

assert not result.success
assert np.all(result.q >= pepper.lower_limits)
assert np.all(result.q <= pepper.upper_limits)
