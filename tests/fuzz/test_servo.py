"""Servos after random targets in random scenes: every tick within all limits and clear by coal."""

import numpy as np

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker

PEPPER = pk.load_pepper()
REACH = np.array([[-0.1, -0.6, 0.4], [0.7, 0.6, 1.5]])


def random_scene(rng):
    """Return a scene of some boxes and balls that leaves the robot free where it stands."""
    while True:
        scene = pk.Scene()
        for k in range(rng.integers(0, 5)):
            place = rng.uniform([0.2, -0.7, 0.2], [0.9, 0.7, 1.4])
            if rng.random() < 0.5:
                scene = scene.add_box(f"box {k}", rng.uniform(0.03, 0.4, 3), place, rng.uniform(-3, 3, 3))
            else:
                scene = scene.add_sphere(f"ball {k}", float(rng.uniform(0.02, 0.15)), place)
        if float(pk.collision.clearance(PEPPER, PEPPER.neutral(), scene)) > 0.003:
            return scene


def random_command(rng, servo):
    kind = rng.integers(5)
    hand = str(rng.choice(["left", "right"]))
    if kind == 0:
        servo.set_twist(hand, rng.normal(0, 0.4, 3), rng.normal(0, 1.5, 3) if rng.random() < 0.5 else None)
    elif kind == 1:
        q = rng.uniform(np.maximum(PEPPER.lower_limits, -3), np.minimum(PEPPER.upper_limits, 3))
        servo.set_target(pk.ik.JointPosture(q, joints=PEPPER.joint_names))
    elif kind == 2:
        servo.set_target(
            [pk.ik.HandPosition(side, rng.uniform(*REACH)) for side in ("left", "right")]
            + [pk.ik.LookAt(rng.uniform(*REACH))]
        )
    elif kind == 3:
        servo.stop()
    else:
        servo.set_target(pk.ik.HandPosition(hand, rng.uniform(*REACH)))


def test_every_tick_keeps_all_limits_and_keeps_clear(amount, rng, tried):
    ticks = wrong = 0
    for _ in range(amount(4, 60, 6000)):
        scene, rate = random_scene(rng), float(rng.choice([25.0, 100.0, 250.0]))
        velocity_scale, acceleration_scale = rng.uniform(0.2, 1.0, 2)
        servo = pk.servo.Servo(
            PEPPER,
            PEPPER.neutral(),
            rate,
            scene,
            velocity_scale=float(velocity_scale),
            acceleration_scale=float(acceleration_scale),
            balance=0.01 if rng.random() < 0.3 else None,
        )
        path = [servo.q]
        for tick in range(100):
            if tick % 20 == 0:
                random_command(rng, servo)
            path.append(servo.step().q)
        q = np.array(path)
        v = np.diff(q, axis=0) * rate
        a = np.diff(np.concatenate([np.zeros((1, PEPPER.n)), v]), axis=0) * rate
        off = ((q < PEPPER.lower_limits - 1e-9) | (q > PEPPER.upper_limits + 1e-9))[1:].any(axis=1)
        off |= (np.abs(v) > velocity_scale * PEPPER.velocity_limits * (1 + 1e-9) + 1e-9).any(axis=1)
        off |= (np.abs(a) > acceleration_scale * PEPPER.acceleration_limits * (1 + 1e-7) + 1e-7).any(axis=1)
        checker = CollisionChecker(PEPPER, scene)
        between = np.concatenate([q[:-1] + share * np.diff(q, axis=0) for share in (0.5, 1.0)])
        off |= np.array([checker.in_collision(x) for x in between]).reshape(2, -1).any(axis=0)
        ticks, wrong = ticks + len(v), wrong + int(off.sum())
    tried("servo ticks", ticks, wrong)
    assert wrong == 0
