"""Push a parcel along a table, and measure the friction force on the hand."""

import numpy as np

import pepper_kin as pk
from pepper_kin.twin import Twin
from pepper_kin.twin.world import World

GRAVITY, MASS, FRICTION, TOP = 9.81, 0.5, 0.4, 0.70
STEP, SPEED = 0.002, 0.1

# The left hand just above a table, flat against a parcel's back; the robot will roll forward.
pepper = pk.load_pepper(base="planar")
target = pk.ik.HandPosition("left", (0.28, 0.18, TOP + 0.05))
solution = pk.ik.solve(pepper, [target], joints="left_arm")
assert solution.success

# Static objects belong to the frozen scene; objects that can move belong to the world.
scene = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.65, 0.0, TOP - 0.02))
world = World(pepper, scene, friction=FRICTION)
world.add_box("parcel", size=(0.12, 0.16, 0.14), mass=MASS, position=(0.46, 0.18, TOP + 0.07))
start = world.bodies["parcel"].position

twin = Twin(pepper, STEP, world=world)
twin.reset(solution.q)
forward = np.zeros(pepper.n)
forward[pepper.joint_index("BaseX")] = SPEED

pushes, ratios, sweeps = [], [], 0
for k in range(700):
    twin.step(solution.q + STEP * (k + 1) * forward, forward)
    below = [contact for contact in world.contacts if contact.names == ("parcel", "table")]
    hand = [contact for contact in world.contacts if "table" not in contact.names]
    if any(contact.force.any() for contact in hand) and k > 400:
        pushes.append(np.linalg.norm(sum(contact.force for contact in hand)))
        along = sum(np.hypot(*contact.force[:2]) for contact in below)
        ratios.append(along / sum(contact.force[2] for contact in below))
    if world.last_solution is not None:
        sweeps = max(sweeps, world.last_solution.problems)

parcel = world.bodies["parcel"]
print(f"the parcel moved by {parcel.position[0] - start[0]:.3f} m, {len(world.contacts)} points in contact")
print(f"hand: {np.median(pushes):.2f} N; friction on a table with the parcel's weight alone:", end=" ")
print(f"{FRICTION * MASS * GRAVITY:.2f} N")
print(f"friction over normal force below the parcel: {np.median(ratios):.4f}; expected: {FRICTION}")
print(f"at most {sweeps} convex problems in one step")
servos = np.abs(twin.state.torque / pepper.effort_limits)
print(f"the hardest working servo: {pepper.joint_names[int(np.argmax(servos))]}, {servos.max():.0%}")

assert parcel.position[0] - start[0] > 0.05
assert abs(parcel.position[2] - (TOP + 0.07)) < 1e-3  # it stays on the table
assert abs(np.median(ratios) - FRICTION) < 2e-3
