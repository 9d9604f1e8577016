"""With machine code switched off the same source runs as plain Python and gives the same answers."""

import json

import numpy as np
import pytest

PROGRAM = """
import json, sys
import numpy as np
import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.core.quadratic_program import solve_program
from pepper_kin.twin.sensors import SensorSuite

pepper = pk.load_pepper()
rng = np.random.default_rng(0)
answers = {}
target = (0.3, 0.25, 0.9)
found = pk.ik.solve(pepper, [pk.ik.HandPosition("left", target)], restarts=0)
answers["inverse kinematics"] = found.q.tolist()
q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (3, pepper.n))
scene = pk.Scene().add_box("box", (0.2, 0.2, 0.2), (0.5, 0.0, 0.6))
block = pk.Scene().add_box("block", (0.1, 0.1, 0.1), (0.3, 0.25, 0.79))
clear = pk.ik.solve(pepper, [pk.ik.HandPosition("left", target)], scene=block, restarts=2)
answers["clear inverse kinematics"] = [float(clear.success), clear.restarts, *clear.q]
answers["collision"] = pk.collision.in_collision(pepper, q, scene).tolist()
near = pk.collision.near_pairs(pepper, pepper.posture("Stand"), 0.03)
answers["near pairs"] = near.distances.tolist()
path = np.stack([pepper.posture("Stand"), pepper.joint_vector({"HeadYaw": 0.3})])
trajectory = pk.retime(pepper, path)
answers["timing"] = [trajectory.duration, *trajectory(0.1)[0].tolist()]
motion = pk.motion.optimize(pepper, path, intervals=4, max_iterations=2)
answers["optimization"] = [motion.descent.cost, *motion.descent.unknowns.ravel()]
twin = pk.Twin(pepper, timestep=0.002)
twin.reset(path[0])
states = [twin.step(path[1]) for _ in range(3)]
world = pk.twin.world.World(pepper, pk.Scene().add_box("table", (0.4, 0.4, 0.04), (2, 0, 0.68)))
world.add_box("parcel", (0.12, 0.16, 0.14), 0.4, (2, 0, 0.77))
run = pk.Twin(pepper, world=world).follow(np.tile(path[0] + 0.3, (3, 1)))
answers["simulation"] = [*states[-1].position, *run.velocity[-1], *world.bodies["parcel"].velocity]
suite = SensorSuite(pepper, seed=1)
readings = suite.read(0.0, path[0], scene=scene.add_sphere("ball", 0.05, (0.18, 0.255, 0.07)))
pressed = [float(reading.value) for name, reading in readings.items() if "bumper" in name]
answers["sensors"] = pressed + readings["laser_left"].value.clip(-9, 9).tolist()
servo = pk.servo.Servo(pepper, path[0])
servo.set_target([pk.ik.HandPosition("right", (0.3, -0.2, 0.9))])
answers["servo"] = servo.step().q.tolist()
v, a = rng.normal(size=(2, pepper.n))
answers["masses"] = [
    *pk.dynamics.center_of_mass(pepper, path[0]),
    *pk.dynamics.centroidal_map(pepper, path[0]).ravel(),
    *pk.dynamics.base_wrench(pepper, path[0], v, a),
]
table = pk.Scene().add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
joints = ("LShoulderPitch", "LShoulderRoll", "LElbowRoll", "LElbowYaw", "HipPitch")
goal = pepper.joint_vector(dict(zip(joints, (0.4, 0.1, -0.9, -1.2, -0.3))))
answers["plan"] = pk.plan(pepper, path[0], goal, table, timeout=120.0).path.ravel().tolist()
free = lambda q: ~((abs(q[:, 0] - 0.5) < 0.1) & (q[:, 1] < 0.7))
problem = planners.Problem([0, 0], [1, 1], [0.1, 0.1], [0.9, 0.1], free, resolution=0.004)
way = planners.rrt_connect(problem, seed=1, timeout=60.0).path
short = planners.shortcut(problem, way, iterations=30, timeout=60.0)
better = planners.aorrtc(problem, way, timeout=60.0, max_iterations=60).path
road = planners.Roadmap(problem)
road.grow(40, timeout=60.0)
found = road.solve(timeout=60.0).path
smooth = planners.smooth(problem, short, resolution=0.002)
ways = [way.points, short.points, better.points, found.points, smooth(np.linspace(0, smooth.length, 9))]
answers["planners"] = np.concatenate(ways).ravel().tolist()
circle = lambda x: ((x**2).sum(axis=1, keepdims=True) - 1.0, 2.0 * x[:, None])
free = lambda x: ~((abs(x[:, 0]) < 0.2) & (x[:, 1] > 0.0))
ends = [np.cos(2.5), np.sin(2.5)], [np.cos(0.6), np.sin(0.6)]
problem = planners.Problem([-2, -2], [2, 2], *ends, free, resolution=0.2)
manifold = planners.ConstraintManifold(circle, 2, 1, 1e-3)
round_ = planners.cbirrt(problem, manifold, seed=1, timeout=60.0).path
short = planners.constrained_shortcut(problem, manifold, round_, iterations=5, timeout=60.0)
answers["manifold"] = [*round_.points.ravel(), *short.points.ravel()]
low, rows, least = -np.ones(3), np.ones((1, 3)), np.array([0.2])
x = solve_program(np.diag([1.0, 2.0, 3.0]), np.array([-4.0, 1.0, 0.5]), low, -low, rows, least)
answers["quadratic program"] = x.tolist()
print(json.dumps({"answers": answers, "numba": "numba" in sys.modules}))
"""


@pytest.fixture(scope="module")
def both(child):
    """Answers of the compiled and of the interpreted run."""
    return [json.loads(child(PROGRAM, NUMBA_DISABLE_JIT=off).stdout)["answers"] for off in (0, 1)]


@pytest.mark.thorough
@pytest.mark.parametrize(
    "algorithm",
    [
        "inverse kinematics",
        "collision",
        "near pairs",
        "timing",
        "optimization",
        "simulation",
        "servo",
        "masses",
        "quadratic program",
        "sensors",
        "clear inverse kinematics",
        "plan",
        "planners",
        "manifold",
    ],
)
def test_the_same_source_gives_the_same_answers(both, algorithm):
    compiled, interpreted = (run[algorithm] for run in both)
    np.testing.assert_allclose(interpreted, compiled, rtol=1e-7, atol=1e-9)
