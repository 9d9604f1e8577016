"""Time of one step of a world: with 0, 4 and 12 contact points, by either solver, and with the robot.

    nice python benchmarks/contacts.py

Cases are run in turns, and medians compared, so that a busy machine disturbs all of them alike.  Every case
also says that it rests: the greatest speed of a body that should not move (one in the air falls).
"""

from __future__ import annotations

import time

import numpy as np

import pepper_kin as pk
from pepper_kin.twin import Twin
from pepper_kin.twin.world import World

ROUNDS, STEPS, H = 20, 100, 0.001


def stack(levels, solver):
    """Boxes on a floor, one on another; none: one box high in the air."""
    world = World(None, pk.Scene().add_half_space("floor", (0, 0, 1)), solver=solver)
    for k in range(max(levels, 1)):
        height = 0.05 + 0.1 * k if levels else 500.0
        world.add_box(f"box {k}", (0.1, 0.1, 0.1), 0.2, (0, 0, height), (0, 0, 0.2 * k))
    return lambda: world.advance_alone(H), world


def leaning(points):
    """Pepper with its hands before a wall: far from it, or leaning on it."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand").copy()
    for side, sign in (("L", 1), ("R", -1)):
        q[pepper.joint_index(f"{side}ShoulderPitch")] = 0.3
        q[pepper.joint_index(f"{side}ElbowRoll")] = -0.4 * sign
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[0, 3]
    wall = hand + 0.195 if points else hand + 0.5
    world = World(pepper, pk.Scene().add_box("wall", (0.1, 2, 2), (wall, 0, 1)))
    twin = Twin(pepper, H, world=world)
    twin.reset(q)
    q[pepper.joint_index("HipPitch")] -= 0.03
    for _ in range(400):
        twin.step(q)
    state = twin.state
    mass, force = twin._integrator.linearized(
        state.position, state.velocity, q, np.zeros(pepper.n), twin._integrator.gravity_torque(state.position)
    )
    return lambda: world.advance(state.position, state.velocity, mass, force, H), world


def main() -> None:
    """Print the table."""
    cases = {
        f"{4 * k:>2} points, {solver}": stack(k, solver)
        for k in (0, 1, 3)
        for solver in ("compiled", "proxsuite")
    }
    cases |= {"robot, nothing near": leaning(False), "robot, hands on a wall": leaning(True)}
    times: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(ROUNDS):
        for name, (step, _) in cases.items():
            start = time.perf_counter()
            for _ in range(STEPS):
                step()
            times[name].append((time.perf_counter() - start) / STEPS)
    for name, (_, world) in cases.items():
        speed = max((np.abs(body.velocity).max() for body in world.bodies.values()), default=0.0)
        mean = 1e6 * np.median(times[name])
        found = len(world.contacts)
        print(f"{name:<24}{mean:8.1f} us a step, {found} points, fastest body {speed:.1e} m/s")


if __name__ == "__main__":
    main()
