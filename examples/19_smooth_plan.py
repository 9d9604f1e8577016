"""A plan with the motion to execute: path and timing optimized together, and the improvement."""

import pepper_kin as pk

pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
goal = pepper.joint_vector({"LShoulderPitch": 0.4, "LElbowRoll": -0.9, "LElbowYaw": -0.8, "HipPitch": -0.3})

plan = pk.plan(pepper, pepper.posture("Stand"), goal, scene, smooth=True)
print(plan.report())
motion, retimed = plan.trajectory, plan.optimized.before
print(f"retimed:   {retimed.duration:.2f} s, jerk {plan.optimized.figures_before.jerk:.0f} /s")
print(f"optimized: {motion.duration:.2f} s, jerk {plan.optimized.figures.jerk:.0f} /s")

# By other code: limits, torques by Newton and Euler, distances by coal.
certificate = motion.check(pepper, scene)
for part in ("velocity", "acceleration", "torque", "obstacle_clearance", "self_clearance"):
    print(getattr(certificate, part).sentence())
    assert getattr(certificate, part).success

assert plan.optimized.success
assert motion.duration < retimed.duration
assert plan.optimized.smoother_by > 0.5
