"""Exact gradients: minimize the holding torques of the arm while the hand stays in place."""

import casadi
import numpy as np

import pepper_kin as pk

pepper = pk.load_pepper()
q0 = pepper.joint_vector({"LShoulderPitch": 0.3, "LShoulderRoll": 0.1, "LElbowRoll": -0.8})
hand = pk.symbolic.frame_pose(pepper, "LArm_effector")  # casadi.Function: q -> 4 x 4
gravity = pk.symbolic.gravity_torque(pepper)  # casadi.Function: q -> n
target = np.array(hand(q0))[:3, 3]

# Least sum of squared holding torques, as shares of the motors' limits, with the palm at the same point.
problem = casadi.Opti()
q = problem.variable(pepper.n)
problem.minimize(casadi.sumsqr(gravity(q) / pepper.effort_limits))
problem.subject_to(problem.bounded(pepper.lower_limits, q, pepper.upper_limits))
problem.subject_to(hand(q)[:3, 3] == target)
problem.set_initial(q, q0)
problem.solver("ipopt", {"expand": True, "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"})
relaxed = np.array(problem.solve().value(q))

before, after = (np.abs(pk.dynamics.gravity_torque(pepper, x)) / pepper.effort_limits for x in (q0, relaxed))
moved = pk.kinematics.frame_pose(pepper, relaxed, "LArm_effector")[:3, 3] - target
print(f"hardest motor: {before.max():.0%} of its torque before, {after.max():.0%} after")
print(f"the palm moved by {1e6 * np.linalg.norm(moved):.3f} um")

# The gradient that ipopt used, against central differences of Pinocchio's torques.
x = casadi.SX.sym("x", pepper.n)
slope = casadi.Function("slope", [x], [casadi.gradient(casadi.sumsqr(gravity(x)), x)])
steps = 1e-6 * np.eye(pepper.n)
effort = [np.sum(pk.dynamics.gravity_torque(pepper, q0 + s * d) ** 2) for d in steps for s in (1, -1)]
differences = (np.array(effort[::2]) - np.array(effort[1::2])) / 2e-6
error = np.abs(np.array(slope(q0)).ravel() - differences).max()
print(f"gradient against finite differences: {error:.1e}")

assert np.linalg.norm(moved) < 1e-6
assert np.sum(after**2) < 0.9 * np.sum(before**2)
assert error < 1e-5
