"""Your own formulas: a cost that keeps the hand away from a hot plate, bounds on a part of the path."""

import casadi
import numpy as np

import pepper_kin as pk
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.motion import Leg, PathCost, plan_legs

pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
plate = np.array([0.35, 0.18, 0.80])
hand = pk.symbolic.frame_pose(pepper, "LArm_effector")

# Over the middle of the plate a piece of the path counts 13 times, less the farther the hand is away; and
# from where the cup is taken to where it is put, the hand is 0.83 m high at least.
heat = PathCost(
    pepper, lambda q: 12 * casadi.exp(-casadi.sumsqr(hand(q)[:3, 3] - plate) / (2 * 0.06**2)), label="heat"
)
high = pk.ik.Expression(pepper, lambda q: hand(q)[2, 3], lower=0.83, label="height of the hand")

take = [pk.ik.HandPosition("left", (0.35, 0.33, 0.84))]
put = [pk.ik.HandPosition("left", (0.36, 0.02, 0.84))]


def hand_way(curve):
    """Return states along a curve, the hand's places, and the length of the path up to each."""
    segments = np.repeat(np.arange(len(curve.breaks) - 1), 200)
    within = np.tile(np.linspace(0.0, 1.0, 200), len(curve.breaks) - 1)
    q = curve.at(segments, within * np.diff(curve.breaks)[segments])
    steps = np.diff(q, axis=0) * motion_bounds(pepper)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
    return q, pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:, :3, 3], lengths


def heat_along(places, lengths):
    """Integrate the price by NumPy."""
    price = 12 * np.exp(-np.sum((places - plate) ** 2, axis=1) / (2 * 0.06**2))
    return np.trapezoid(price, lengths)


ways = {}
for name, costs in (("without", []), ("with", [heat])):
    legs = [Leg(take), Leg(put, constraints=[high], costs=costs)]
    found = plan_legs(pepper, pepper.posture("Ready"), legs, scene, joints="whole_body", timeout=20.0)
    print(f"{name} the price:\n{found.report()}")
    assert found.success
    ways[name] = hand_way(found.plans[1].curve)
cost = found.plans[1].costs[0]
trajectory = found.retime(pepper)
print(f"{trajectory.duration:.2f} s; mean price {cost.mean:.2f}, heat {cost.integral:.2f} m")

# An independent look: heights and heat from poses alone, distances by coal.
for name, (q, places, lengths) in ways.items():
    nearest = np.linalg.norm(places - plate, axis=1).min()
    clearance = pk.collision.clearance(pepper, q, scene, to="obstacles").min()
    print(
        f"{name} the price: heat {heat_along(places, lengths):.2f} m, {100 * nearest:.1f} cm from the plate, "
        f"lowest {places[:, 2].min():.3f} m, {1000 * clearance:.1f} mm from obstacles"
    )
    assert places[:, 2].min() >= 0.83 - high.tolerance
    assert clearance > 0
assert abs(heat_along(*ways["with"][1:]) - cost.integral) < 0.01 * cost.integral
assert heat_along(*ways["with"][1:]) < 0.7 * heat_along(*ways["without"][1:])
