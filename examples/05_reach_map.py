"""Map where the left hand can go: with the arm alone, and with the torso's help."""

import numpy as np

import pepper_kin as pk
from pepper_kin.kinematics import reach_map

pepper = pk.load_pepper()
frame = "LArm_effector"
arm, torso = pepper.joint_group("left_arm"), pepper.joint_group("torso")

# 1,000,000 samples (the default) take seconds and find the rim better.
alone = reach_map(pepper, frame, joints=arm, samples=100_000, resolution=0.1)
helped = reach_map(pepper, frame, joints=(*torso, *arm), samples=100_000, resolution=0.1)
print(f"arm alone:      {alone.volume:.2f} m^3")
print(f"with the torso: {helped.volume:.2f} m^3")

# A table's edge, a shelf, and the floor in front of the robot.
points = np.array([[0.35, 0.20, 0.80], [0.20, 0.30, 1.25], [0.35, 0.15, 0.25]])
for point, near, far in zip(points, alone.contains(points), helped.contains(points), strict=True):
    print(f"{point}: arm alone {'yes' if near else 'no'}, with the torso {'yes' if far else 'no'}")

# The voxel where the hand moves most freely in all directions.
freest = np.unravel_index(np.argmax(alone.best), alone.best.shape)
print(f"most manipulable near {alone.origin + (np.array(freest) + 0.5) * alone.resolution} m")

assert helped.volume > 1.5 * alone.volume
assert alone.contains(points[0])
