"""The machine code at work, in a separate process: `python core_job.py '{"jobs": ["ik"], "count": 3, ...}'`.

Prints one line of JSON: for each job hashes of its results, which have to be the same wherever memory lies
and whatever was in it; and how often each compiled function was called from Python.  With "guard" every array
lies beside a page that may not be touched (`guarded_memory`).
"""

import faulthandler
import hashlib
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

faulthandler.enable()

Job = Callable[[np.random.Generator, int], Iterator[Any]]
JOBS: dict[str, Job] = {}


def job(function: Job) -> Job:
    """Add a job under the name of its function."""
    JOBS[function.__name__] = function
    return function


def states(robot: Any, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return configurations within the limits; joints without any within 3 rad."""
    return rng.uniform(
        np.maximum(robot.lower_limits, -3), np.minimum(robot.upper_limits, 3), (count, robot.n)
    )


def world(pk: Any, rng: np.random.Generator) -> Any:
    """Return a scene with an object of every kind."""
    corners = rng.normal(size=(12, 3)) * 0.08
    faces = [[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]]
    place = lambda: (*rng.uniform([0.35, -0.6], [0.8, 0.6]), rng.uniform(0.3, 1.3))  # noqa: E731
    return (
        pk.Scene()
        .add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
        .add("ball", pk.model.Sphere(0.05), position=place())
        .add("can", pk.model.Cylinder(0.04, 0.2), position=place())
        .add("bar", pk.model.Capsule(0.03, 0.3), position=place())
        .add("stone", pk.collision.ConvexMesh(corners), position=place())
        .add("surface", pk.collision.TriangleMesh(corners[:4], faces), position=place())
        .add("cloud", pk.collision.PointCloud(rng.normal(size=(300, 3)) * 0.05, 0.01), position=place())
        .add("floor", pk.collision.HalfSpace(), position=(0.0, 0.0, -0.01))
    )


@job
def quantities(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Kernels of all quantities: one state, one vector of states, batches, both formats."""
    import pepper_kin as pk

    robots = [pk.load_pepper(), pk.load_pepper(base="planar", hands="mimic")]
    frame = "LArm_effector"
    extra = {"frame_poses": ((frame, "CameraTop_frame"),)}
    for robot in robots[: 1 + (count > 1)]:
        for number, name in enumerate(sorted(pk.symbolic.QUANTITIES)):
            if robot is not robots[0] and number % 5 != count % 5:
                continue  # of the larger robot some, others with another count
            args = extra.get(name, (frame,) if name.startswith("frame_") or name == "manipulability" else ())
            for dtype in ("float64", "float32")[: 1 + (number % 4 == 0)]:
                kernel = pk.batch.kernel(robot, name, *args, dtype=dtype)
                yield from called_directly(kernel, rng)
                for rows in (1, kernel.lanes, *rng.integers(1, 40, count)):
                    shapes = kernel.signature.input_shapes
                    given = [rng.normal(size=(rows, *core_of(shape))).astype(dtype) for shape in shapes]
                    yield name, dtype, kernel(*given)


def core_of(shape: tuple[int, int]) -> tuple[int, ...]:
    """Return the trailing axes of an input or output."""
    return shape[:1] if shape[1] == 1 else shape


def called_directly(kernel: Any, rng: np.random.Generator) -> Iterator[Any]:
    """Call the C functions of a kernel on arrays of exactly the documented size."""
    import ctypes

    sizes = [sum(rows * columns for rows, columns in shapes) for shapes in
             (kernel.signature.input_shapes, kernel.signature.output_shapes)]  # fmt: skip
    for address, lanes in ((kernel.single_address, 1), (kernel.block_address, kernel.lanes)):
        given = rng.normal(size=sizes[0] * lanes).astype(kernel.dtype)
        result, work = np.empty(sizes[1] * lanes, kernel.dtype), np.empty(kernel.work_size, kernel.dtype)
        ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(address)(
            *(a.ctypes.data for a in (given, result, work))
        )
        yield result


@job
def ik(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Tasks of all kinds, alone and together, with and without a scene; batches; several solutions."""
    import pepper_kin as pk

    robot, tasks = pk.load_pepper(), pk.ik
    for number in range(count):
        q = states(robot, rng, 1)[0]
        pose = pk.kinematics.frame_pose(robot, q, "LArm_effector")
        other = pk.kinematics.frame_pose(robot, q, "RArm_effector")
        mass, point = pk.dynamics.center_of_mass(robot, q), pose[:3, 3]
        kinds = [
            tasks.HandPosition("left", point),
            tasks.HandPose("left", pose),
            tasks.FrameOrientation("LArm_effector", pose[:3, :3]),
            tasks.FrameInPlane("LArm_effector", point),
            tasks.AxisAlignment("LArm_effector", pose[:3, 0]),
            tasks.RelativePose("RArm_effector", "LArm_effector", np.linalg.inv(pose) @ other),
            tasks.RelativePosition("RArm_effector", "LArm_effector", (np.linalg.inv(pose) @ other)[:3, 3]),
            tasks.LookAt(point),
            tasks.JointPosture(q),
            tasks.JointValue("HeadYaw", q[robot.joint_index("HeadYaw")]),
            tasks.CenterOfMass(mass[:2]),
            tasks.CenterOfMassOverWheels(0.01),
        ]
        chosen = [kinds[number % len(kinds)], *(kinds[k] for k in rng.choice(len(kinds), number % 3))]
        scene = world(pk, rng) if number % 2 else None
        found = tasks.solve(robot, chosen, scene=scene, seed=number, restarts=4)
        yield found.q, found.status.name
        if number % 4 == 0:
            targets = pk.kinematics.frame_pose(robot, states(robot, rng, 5), "LArm_effector")[:, :3, 3]
            batch = tasks.solve_batch(robot, tasks.HandPosition("left", targets), scene=scene, seed=number)
            yield batch.q, batch.success
        if number % 4 == 1:
            yield list(tasks.solutions(robot, kinds[0], scene=scene, count=3, seed=number))


@job
def verdicts(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Checks of states and edges, distances, pairs, with objects of all kinds, one of them held."""
    import pepper_kin as pk

    robot = pk.load_pepper()
    for number in range(count):
        scene = world(pk, rng)
        q = states(robot, rng, 30)
        if number % 2:
            scene = scene.attach("can", "LArm_effector", pepper=robot, q=q[0])
        yield pk.collision.in_collision(robot, q, scene), pk.collision.clearance(robot, q[:3], scene)
        least = pk.collision.least_clearance(robot, q[:4], scene)
        yield least.distance, least.index
        near = pk.collision.near_pairs(robot, q[0], 0.1, scene)
        yield near.distances, near.gradients
        yield pk.motion.validate(robot, q[:2], scene).status.name


def price_near_base(hand: Any) -> Callable[[Any], Any]:
    """Return a price of configurations that falls with the distance of the hand from the origin."""
    import casadi

    return lambda q: 1 + 5 * casadi.exp(-casadi.sumsqr(hand(q)[:3, 3]) / 0.01)


@job
def plans(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Plans to tasks, to configurations and of a base; with constraints, costs and optimization."""
    import pepper_kin as pk

    robot = pk.load_pepper()
    stand = robot.posture("Stand")
    for number in range(count):
        scene = (
            world(pk, rng)
            if number % 2
            else pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
        )
        point = rng.uniform((0.33, 0.12, 0.80), (0.40, 0.25, 0.90))
        goal = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
        options: dict[str, Any] = {"timeout": 60.0, "seed": number}
        plan = pk.plan(robot, stand, goal, scene, **options)
        yield plan.status.name, plan.path
        kind = number % 4
        if kind == 1:
            drive = pk.load_pepper(base="planar")
            away = drive.posture("Stand")
            away[:3] = rng.uniform(-1, 1, 3)
            scene = pk.Scene().add_box("post", size=(0.1, 0.1, 1.0), position=(2.0, 0.0, 0.5))
            yield pk.plan(drive, drive.posture("Stand"), away, scene, **options).path
        elif kind == 2 and plan.success:
            found = pk.motion.optimize(robot, plan, scene, intervals=8)
            yield found.status.name
        elif kind == 3:
            up = pk.ik.AxisAlignment("LArm_effector", (0, 0, 1), axis=(0, 0, 1), tolerance=math.radians(5))
            level = pk.ik.solve(
                robot, [pk.ik.HandPosition("left", (0.28, 0.32, 0.85)), up], joints="left_arm"
            )
            goal = [pk.ik.HandPosition("left", (0.30, 0.05, 0.85))]
            options["joints"] = "left_arm"
            yield pk.motion.plan_constrained(robot, level.q, goal, None, [up], **options).path
            heat = pk.motion.PathCost(robot, price_near_base(pk.symbolic.frame_pose(robot, "LArm_effector")))
            yield pk.motion.plan_costed(robot, level.q, goal, None, [heat], **options).success


@job
def timings(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Timing of plans and waypoints: torque, balance, jerk, loads; certificates; motions without a plan."""
    import pepper_kin as pk

    robot = pk.load_pepper()
    for number in range(count):
        middle = robot.posture("Stand")
        points = middle + 0.2 * (states(robot, rng, 2 + number % 3) - middle)
        options: list[dict[str, Any]] = [
            {}, {"balance": 0.01}, {"jerk": "moderate"},
            {"hand_speed": 0.4}, {"payload": {"LArm_effector": 0.3}},
        ]  # fmt: skip
        motion = pk.retime(robot, points, **options[number % len(options)])
        yield motion.breaks, motion.coefficients
        yield motion.check(robot, collisions=False).velocity.value
        repaired = pk.trajectory.enforce_limits(robot, motion.scaled(2.0) if number % 2 else motion)
        yield repaired.breaks
        online = pk.trajectory.OnlineMotion(robot, points[0])
        online.set_target(points[-1])
        yield [online.step(0.01).position for _ in range(20)]


@job
def twin(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Runs of one twin, of many, with a world and pushes; wheels and balance."""
    import pepper_kin as pk

    robot, drive = pk.load_pepper(), pk.load_pepper(base="planar")
    wave = pk.motion.gesture(robot, "wave")
    for number in range(count):
        one = pk.Twin(robot, substeps=1 + number % 3)
        one.reset(states(robot, rng, 1)[0])
        one.push("LArm_effector", rng.normal(size=3) * 5, duration=0.05)
        for _ in range(60):
            state = one.step(robot.posture("Stand"))
        yield state.position, state.torque
        batch = pk.TwinBatch(
            robot, 3 + number % 7, mass_scale={"left_arm": rng.uniform(0.8, 1.2, 3 + number % 7)}
        )
        run = batch.execute(wave, hold_time=0.0, every=50)
        yield run.final_position
        scene = pk.Scene().add_box("floor", size=(4, 4, 0.1), position=(0, 0, -0.05))
        space = pk.twin.world.World(drive, scene)
        for body in range(3):
            space.add_box(
                f"box {body}", size=(0.1, 0.1, 0.1), mass=0.5, position=(1.0, 0.3 * body, 0.06 + 0.1 * body)
            )
            space.add_ball(
                f"ball {body}", radius=0.05, mass=0.2, position=(1.0, 0.3 * body, 0.3 + 0.1 * body)
            )
        moving = pk.Twin(drive, 0.002, world=space)
        for _ in range(40):
            moving.step(drive.posture("Stand"))
        yield moving.state.position, [space.bodies[name].pose for name in sorted(space.bodies)]


@job
def sensors(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Cameras, rays, sonar, lasers, inertia and odometry."""
    import pepper_kin as pk

    robot = pk.load_pepper(base="planar")
    for number in range(count):
        scene = world(pk, rng)
        q, v = states(robot, rng, 1)[0], rng.normal(size=robot.n)
        q[:3] = 0.0
        suite = pk.twin.sensors.SensorSuite(robot, seed=number, scene=scene)
        readings = suite.read(0.0, q, v, np.zeros(robot.n), scene=scene)
        yield [readings[name].value for name in sorted(readings)]
        camera = pk.twin.sensors.Camera(robot, "camera_depth", "QQVGA", lens=bool(number % 2))
        yield camera.depth(q, scene)
        yield pk.collision.without_robot(robot, q, rng.normal(size=(50, 3)), scene)


@job
def servo(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Targets followed tick by tick, with collisions and balance."""
    import pepper_kin as pk

    robot = pk.load_pepper()
    for number in range(count):
        options: dict[str, Any] = {"scene": world(pk, rng)} if number % 2 else {"balance": 0.01}
        follower = pk.servo.Servo(robot, robot.posture("Stand"), **options)
        for tick in range(40):
            if tick % 10 == 0:
                point = rng.uniform((0.25, 0.05, 0.8), (0.45, 0.35, 1.1))
                follower.set_target([pk.ik.HandPosition("left", point), pk.ik.LookAt(point)])
            state = follower.step()
        yield state.q, state.v, state.status.name


@job
def placing(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Places to stand."""
    import pepper_kin as pk

    robot = pk.load_pepper()
    for number in range(count):
        point = rng.uniform((1.5, 0.0, 0.8), (2.0, 0.5, 1.0))
        tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
        found = pk.base_placement.place_base(robot, tasks, seed=number, candidates=16)
        yield found.places, found.scores


@job
def searches(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """Planners without a robot: trees, roads, manifolds, prices, cars."""
    from pepper_kin import planners as p
    from pepper_kin.exceptions import InfeasibleError

    for number in range(count):
        n = 2 + number % 4
        centers = rng.uniform(0.2, 0.8, (5, n))
        free = lambda x, c=centers: (np.linalg.norm(x[:, None] - c, axis=2) > 0.15).all(axis=1)  # noqa: E731
        space = p.Problem([0.0] * n, [1.0] * n, [0.02] * n, [0.98] * n, free, resolution=0.02)
        found = p.rrt_connect(space, seed=number, timeout=60.0)
        yield found.path.points
        short = p.shortcut(space, found.path, seed=number, timeout=60.0)
        try:
            curve = p.smooth(space, short).coefficients
        except InfeasibleError as refusal:  # the path enters an obstacle between its states
            curve = str(refusal)
        yield short.points, curve
        # What two of the searches find depends on where the time slices of a slow machine end: not compared.
        better = p.aorrtc(space, found.path, seed=number, timeout=60.0, max_iterations=60)
        yield better.success, better.cost <= found.cost
        if number % 3 == 0:
            yield p.Roadmap(space, seed=number).solve([0.02] * n, [0.98] * n, timeout=60.0).path.points
        price = p.StateCost(lambda x: ((x**2).sum(axis=1)[:, None], 2 * x[:, None, :]), n)
        yield p.transition_rrt(space, price, seed=number, timeout=60.0).path.points
        yield p.descend_cost(
            space, price, short, seed=number, iterations=20, shortcuts=10, timeout=60.0
        ).points
        ball = p.ConstraintManifold(
            lambda x: ((x**2).sum(axis=1)[:, None] - 1, 2 * x[:, None, :]), 3, 1, 1e-3
        )
        open_ = lambda x: np.ones(len(x), dtype=bool)  # noqa: E731
        sphere = p.Problem([-1.2] * 3, [1.2] * 3, [0, 0, 1], [0, 0, -1], open_, resolution=0.05)
        around = p.cbirrt(sphere, ball, seed=number, timeout=60.0)
        again = p.constrained_shortcut(sphere, ball, around.path, iterations=10, timeout=60.0)
        yield around.success, ball.worst(again.points) <= 2.0
        turns = ([-3, -3, -math.pi], [3, 3, math.pi])
        car = p.Problem(*turns, [-2, -2, 0], [2, 2, 1], open_, weights=(1.0, 1.0, 0.2), resolution=0.05)
        driven = p.car_connect(car, 0.5, seed=number, timeout=60.0)
        yield driven.curve.lengths, driven.curve(np.linspace(0, driven.length, 17))


def doubled(rng: np.random.Generator) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray]:
    """Return a kernel that doubles 3 numbers, and arrays for it."""
    import casadi

    from pepper_kin.kernels import compile_function

    x = casadi.SX.sym("x", 3)
    kernel = compile_function(casadi.Function("doubled", [x], [2 * x]))
    return kernel, rng.normal(size=3), np.empty(3), np.empty(kernel.work_size)


def call_at(kernel: Any, *addresses: int) -> None:
    """Call a kernel's C function for one state."""
    import ctypes

    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(kernel.single_address)(*addresses)


@job
def ready(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """A kernel on memory of the right size."""
    kernel, given, result, work = doubled(rng)
    call_at(kernel, given.ctypes.data, result.ctypes.data, work.ctypes.data)
    yield result


@job
def overrun(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """A kernel whose result has room for one number less than it writes: a deliberate fault."""
    kernel, given, result, work = doubled(rng)
    call_at(kernel, given.ctypes.data, result[1:].ctypes.data, work.ctypes.data)
    yield result


@job
def underrun(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """A kernel that reads from one number before its input: a deliberate fault."""
    kernel, given, result, work = doubled(rng)
    call_at(kernel, given.ctypes.data - 8, result.ctypes.data, work.ctypes.data)
    yield result


@job
def late(rng: np.random.Generator, count: int) -> Iterator[Any]:
    """A kernel that reads memory that was freed: a deliberate fault."""
    kernel, given, result, work = doubled(rng)
    address = given.ctypes.data
    del given
    call_at(kernel, address, result.ctypes.data, work.ctypes.data)
    yield result


def bytes_of(value: Any) -> bytes:
    """Return the content of nested results."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, (tuple, list)):
        return b"".join(map(bytes_of, value))
    return repr(value).encode()


def counted() -> Counter[str]:
    """Count the calls of compiled functions from Python from now on, by name."""
    from pepper_kin.kernels import calling

    calls: Counter[str] = Counter()
    usual = calling.builtin_function

    def builtin_function(function: Any, entry: int) -> Any:
        native, name = usual(function, entry), f"{function.__module__}.{function.__qualname__}"

        def call(*arguments: Any) -> Any:
            calls[name] += 1
            return native(*arguments)

        return call

    calling.builtin_function = builtin_function
    return calls


def main(options: dict[str, Any]) -> None:
    """Run jobs and print what came out."""
    if options.get("guard"):
        from guarded_memory import guard

        guard(options["guard"])
    calls, results = counted(), {}
    for name in options["jobs"]:
        began, parts = time.process_time(), []
        for value in JOBS[name](np.random.default_rng(options["seed"]), options["count"]):
            parts.append(hashlib.sha256(bytes_of(value)).hexdigest()[:16])
        seconds = time.process_time() - began
        results[name] = {"results": len(parts), "parts": parts, "seconds": seconds}
        print(f"{name}: {len(parts)} results in {seconds:.1f} s", file=sys.stderr, flush=True)
    print(json.dumps({"jobs": results, "calls": dict(calls)}))


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
