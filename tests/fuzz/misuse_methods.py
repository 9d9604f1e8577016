"""Methods of public objects with arguments that work: how the object is made, and the arguments of each.

What takes arrays or another robot is named here; methods are called on an object made anew each time.  What
solvers ask of a task (`residual`, ...) and what converts coordinates for Pinocchio (`PepperModel.to_full`,
...) is left out: these are called in loops, with vectors that were checked before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

import pepper_kin as pk

if TYPE_CHECKING:
    from misuse_values import Samples

Methods = dict[str, dict[str, Any]]
Entry = tuple[str, Callable[[], Any], Methods]


def of_models_and_scenes(s: Samples) -> Iterator[Entry]:
    """Yield objects of `model`, `collision`, `kinematics`, `batch` and `base_placement`."""
    q, points = s.stand, np.vstack([np.eye(3), np.zeros(3)])
    place, faces = np.array([1.0, 0.0, 0.5]), np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])
    yield "PepperModel", lambda: s.robot, {
        "joint_vector": {"values": q, "rest": q}, "with_limits": {"velocity": np.ones(s.n)},
        "with_masses": {"masses": {"Head": 2.0}},
    }  # fmt: skip
    yield "CollisionChecker", lambda: pk.collision.CollisionChecker(s.robot, s.scene), {
        **{name: {"q": q} for name in ("clearance", "closest_pair", "contacts", "in_collision")},
        "contact_points": {"q": q, "within": 0.1}, "with_margins": {"margin": 0.01, "self_margin": 0.01},
    }  # fmt: skip
    yield "Scene", lambda: s.scene, {
        "add": {"name": "a", "geometry": s.box, "position": place, "rpy": np.zeros(3)},
        "add_capsule": {"name": "a", "radius": 0.1, "length": 0.2, "position": place},
        "add_convex_mesh": {"name": "a", "vertices": points, "position": place, "scale": np.ones(3)},
        "add_mesh": {"name": "a", "vertices": points, "faces": faces, "position": place},
        "add_half_space": {"name": "a", "normal": np.array([0.0, 0.0, 1.0]), "offset": -1.0},
        "add_point_cloud": {"name": "a", "points": points, "radius": 0.01, "position": place},
        "move": {"name": "table", "position": place, "rpy": np.zeros(3)},
        "attach": {"name": "table", "frame": "LArm_effector", "pepper": s.robot, "q": q, "mass": 0.1},
        "padded": {"margin": 0.01},
    }  # fmt: skip
    reach = pk.kinematics.reach_map(s.robot, "LArm_effector", resolution=0.2, samples=1000)
    yield "ReachMap", lambda: reach, {"contains": {"points": np.array([[0.3, 0.2, 0.9]])}}
    places = pk.base_placement.placement_map(
        s.drive, [s.task], center=(0.0, 0.0), size=0.4, resolution=0.2, headings=2
    )
    yield "PlacementMap", lambda: places, {"score_at": {"point": np.array([0.0, 0.0])}}
    yield (
        "Kernel",
        lambda: OneName(pk.batch.kernel(s.robot, "mass_matrix"), 1),
        {"call": {"a": np.tile(q, (5, 1)), "out": None, "threads": 1}},
    )


class OneName:
    """A kernel whose inputs have names, for calls by name."""

    def __init__(self, kernel: Any, inputs: int) -> None:
        self.kernel, self.inputs = kernel, inputs

    def call(self, out: Any = None, threads: int = 1, **given: Any) -> Any:
        """Call the kernel."""
        return self.kernel(*given.values(), out=out, threads=threads)


def of_motions(s: Samples) -> Iterator[Entry]:
    """Yield objects of `servo`, `motion` and `trajectory`."""
    q = s.stand
    servo = lambda: pk.servo.Servo(s.robot, q)  # noqa: E731
    yield "Servo", servo, {"set_target": {"tasks": [s.task]}, "set_scene": {"scene": s.scene}}
    price = pk.motion.PathCost(s.robot, lambda q: q[0] ** 2)
    yield "PathCost", lambda: price, {"values": {"q": np.tile(q, (3, 1))}}
    at = {"t": np.array([0.1, 0.2])}
    inside = {"segment": np.array([0, 1]), "local_time": np.array([0.01, 0.01])}
    yield "Trajectory", lambda: s.motion, {
        "__call__": at, "jerk": at, "at_segments": inside, "jerk_at_segments": inside,
        "active_limits": {"pepper": s.robot, "t": at["t"]}, "check": {"pepper": s.robot, "scene": s.scene},
        "blend": {"other": s.motion.reversed(), "overlap": 0.1},
        "is_close": {"other": s.motion}, "scaled": {"factor": 2.0}, "with_duration": {"duration": 5.0},
        "between": {"start": 0.1, "end": 0.3}, "sample": {"dt": 0.01},
    }  # fmt: skip
    yield (
        "OnlineMotion",
        lambda: pk.trajectory.OnlineMotion(s.robot, q),
        {"set_target": {"q_target": s.raised, "v_target": s.zero}, "step": {"dt": 0.01}},
    )
    yield "Timeline", lambda: s.timeline, {"to_trajectory": {"pepper": s.robot, "start": q}}


def of_planners(s: Samples) -> Iterator[Entry]:
    """Yield objects of `planners`, in the plane."""
    states, ends = (
        np.array([[0.2, 0.2], [0.5, 0.5]]),
        {"start": np.full(2, 0.2), "goals": np.full((1, 2), 0.8)},
    )
    along, metric = {"s": np.array([0.1, 0.2])}, pk.planners.Metric([1.0, 2.0])
    validator = lambda: s.problem.validator()  # noqa: E731
    yield (
        "Metric",
        lambda: metric,
        {"distance": {"a": states, "b": states}, "arc_lengths": {"points": states}},
    )
    yield "Path", lambda: s.path, {"__call__": along, "edge_index": along, "resample": {"spacing": 0.1}}
    smooth = pk.planners.smooth(s.problem, s.path)
    yield "SmoothPath", lambda: smooth, {"__call__": along, "sample": {"spacing": 0.1}}
    yield "Problem", lambda: s.problem, {"begun_at": ends, "resolved": {"resolution": 0.1}}
    yield (
        "MotionValidator",
        validator,
        {
            "states_valid": {"states": states},
            "last_valid_step": {"a": states[0], "b": states[1], "steps": 5},
        },
    )
    yield "Roadmap", lambda: pk.planners.Roadmap(s.problem), {"solve": ends, "grow": {"nodes": 20}}
    yield (
        "ConstraintManifold",
        lambda: s.line,
        {name: {"states": states} for name in ("contains", "errors", "worst")},
    )
    yield "StateCost", lambda: s.price, {"at": {"states": states}, "along": {"path": s.path}}
    curve = pk.planners.car_curve(np.zeros(3), np.array([1.0, 1.0, 0.5]), 0.3)
    yield "CarCurve", lambda: curve, {"__call__": along, "part": {"begin": 0.1, "end": 0.2}}


def of_twins(s: Samples) -> Iterator[Entry]:
    """Yield objects of `twin` and of what is in it."""
    q, v, still, base = s.stand, s.zero, s.still, pk.twin.base.OmniBase()
    target, many = (
        {"position": q, "velocity": v, "acceleration": v, "effort": v, "load": v},
        np.tile(q, (3, 1)),
    )
    run = {name: np.tile(value, (5, 1)) for name, value in target.items()}
    yield "Twin", lambda: pk.Twin(s.robot), {
        "step": target, "follow": run, "reset": {"q": q, "v": v}, "execute": {"trajectory": s.motion},
        "push": {"frame": "LArm_effector", "force": np.ones(3), "point": np.zeros(3), "duration": 0.1},
    }  # fmt: skip
    yield "TwinBatch", lambda: pk.TwinBatch(s.robot, 3), {
        "follow": {**run, "every": 1}, "execute": {"trajectory": s.motion, "every": 50},
        "reset": {"q": many, "v": 0 * many, "rows": np.array([0, 1, 2])},
    }  # fmt: skip
    command = {"q": q, "v": v, "q_ref": q, "v_ref": v, "feedforward": v}
    motors = pk.Twin(s.robot).actuators
    yield "Integrator", lambda: pk.twin.Integrator(s.robot, 0.001, motors), {
        "step": {**command, "load": v}, "linearized": {**command, "load": v}, "present_torque": command,
        "gravity_torque": {"q": q},
        "run": {"q": q, "v": v, "command": pk.twin.integrator.Command(still, 0 * still, 0 * still),
                "load": 0 * still, "every": 1},
    }  # fmt: skip
    monitor = {"time": s.times, "q": still, "v": 0 * still, "a": 0 * still}
    yield "BalanceMonitor", lambda: s.monitor, {"assess": monitor}
    turns = {"wheel_speeds": np.ones(3)}
    yield "OmniBase", lambda: base, {
        "body_twist": turns, "wheel_slip": {"twist": np.ones(3), **turns},
        "wheel_speeds": {"twist": np.ones(3)}, "limited": {"twist": np.ones(3)},
    }  # fmt: skip
    yield "Odometry", lambda: pk.twin.base.Odometry(base), {"add": {"turns": np.ones(3)}}
    yield (
        "BaseController",
        lambda: pk.twin.base.BaseController(base),
        {"command": {"twist": np.zeros(3)}, "reset": {"pose": np.zeros(3)}, "step": {"timestep": 0.01}},
    )
    rays = {"origins": np.zeros((4, 3)), "directions": np.eye(3)[[0, 1, 2, 0]]}
    caster = lambda: pk.twin.sensors.RayCaster([s.box, s.box], np.tile(np.eye(4), (2, 1, 1)))  # noqa: E731
    yield "RayCaster", caster, {
        "cast": {**rays, "maximum": np.full(4, 5.0)}, "distances": rays,
        "place": {"poses": np.tile(np.eye(4), (2, 1, 1))},
    }  # fmt: skip
    looked = {"q": q, "scene": s.scene, **rays}
    around = pk.twin.sensors.RobotRays(s.robot)
    yield "RobotRays", lambda: around, {"look": looked, "distances": looked}
    eye = pk.twin.sensors.Camera(s.robot, "camera_top", "QQVGA")
    yield (
        "Camera",
        lambda: eye,
        {"depth": {"q": q, "scene": s.scene}, "project": {"q": q, "points": np.array([[1.0, 0.0, 1.0]])}},
    )
    suite = lambda: pk.twin.sensors.SensorSuite(s.robot)  # noqa: E731
    yield "SensorSuite", suite, {"read": {"time": 0.0, "q": q, "v": v, "a": v, "torque": v, "scene": s.scene}}
    world = lambda: pk.twin.world.World(s.drive, s.scene)  # noqa: E731
    ball = {"radius": 0.05, "mass": 0.2, "position": np.array([2.0, 0.0, 1.0]), "velocity": np.zeros(6)}
    box = {"size": np.full(3, 0.1), "mass": 0.2, "position": ball["position"], "rpy": np.zeros(3)}
    yield "World", world, {"add_ball": {"name": "a", **ball}, "add_box": {"name": "a", **box}}


SUBJECTS = (of_models_and_scenes, of_motions, of_planners, of_twins)


def methods_of(subject: str, samples: Samples) -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    """Yield name, function and arguments by name of methods; `subject` is the name of a function above."""
    entries = {function.__name__: function for function in SUBJECTS}[subject](samples)
    for name, make, methods in entries:
        for method, arguments in methods.items():
            yield f"{name}.{method}", on_new_object(make, method), arguments


def on_new_object(make: Callable[[], Any], method: str) -> Callable[..., Any]:
    """Return a function that makes an object and calls a method of it."""
    return lambda **arguments: getattr(make(), method)(**arguments)
