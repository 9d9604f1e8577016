"""Carry a tray around a post: the palm stays level within five degrees along the whole path."""

import numpy as np

import pepper_kin as pk
from pepper_kin.motion import plan_constrained

pepper = pk.load_pepper()
scene = pk.Scene().add_box("post", size=(0.05, 0.05, 1.0), position=(0.33, 0.17, 0.85))
up, tilt = np.array([0.0, 0.0, 1.0]), np.radians(5.0)
level = pk.ik.AxisAlignment("LArm_effector", up, axis=(0, 0, 1), tolerance=tilt, label="tray")

# Left of the post, with the palm level to begin with.
stand = pepper.posture("Stand")
tasks = [pk.ik.HandPosition("left", (0.28, 0.32, 0.85)), level]
start = pk.ik.solve(pepper, tasks, start=stand, scene=scene, joints="left_arm")
print(start.report())

# To the right of it; the constraint is a task of the goal too.
target = np.array([0.30, 0.05, 0.85])
goal = [pk.ik.HandPosition("left", target)]
plan = plan_constrained(pepper, start.q, goal, scene, [level], joints="left_arm")
print(plan.report())
trajectory = pk.retime(pepper, plan)
print(f"{trajectory.duration:.2f} s")

# An independent look at the curve that retime follows: the tilt from the pose alone, distances by coal.
spline = plan.curve
segments = np.repeat(np.arange(len(spline.breaks) - 1), 200)
within = np.tile(np.linspace(0.0, 1.0, 200), len(spline.breaks) - 1)
q = spline.at(segments, within * np.diff(spline.breaks)[segments])
poses = pk.kinematics.frame_pose(pepper, q, "LArm_effector")
tilts = np.arccos(np.clip(poses[:, :3, 2] @ up, -1.0, 1.0))
clearance = pk.collision.clearance(pepper, q, scene, to="obstacles").min()
print(
    f"tilt to {np.degrees(tilts.max()):.2f} deg, {1000 * clearance:.1f} mm off the scene at {len(q)} states"
)
assert plan.success
assert tilts.max() <= tilt
assert clearance > 0
assert np.linalg.norm(poses[-1, :3, 3] - target) < 1e-3

# Without the constraint the tray would tip over.
free = pk.plan(pepper, start.q, plan.goal, scene, joints="left_arm")
tipped = pk.kinematics.frame_pose(pepper, free.path, "LArm_effector")[:, :3, 2] @ up
print(f"without the constraint: {np.degrees(np.arccos(tipped.min())):.0f} deg")
assert np.arccos(tipped.min()) > tilt
