"""Calls that work: arguments of public functions by the parameter's name, and objects with their methods.

What solvers ask of a task (`residual`, ...) and what converts coordinates for Pinocchio
(`PepperModel.to_full`, ...) is left out: these are called in loops, with vectors that were checked before.
"""

from __future__ import annotations

import inspect
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import pepper_kin as pk

MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
ONE_JOINT = f"""<robot name="arm"><link name="base">{MASS}</link><link name="LArm_effector">{MASS}</link>
<joint name="HeadYaw" type="revolute"><parent link="base"/><child link="LArm_effector"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="10"/></joint></robot>"""
KEEP_SHORT = ("samples", "candidates", "restarts", "starts", "timeout", "iterations", "max_iterations")
"""Options whose defaults would take long; the short value goes in their place."""

Methods = dict[str, tuple[Callable[[], Any], dict[str, dict[str, Any]]]]


class Samples:
    """Objects that arguments are made of: a robot, a scene, a motion, a problem of the planners, files."""

    def __init__(self) -> None:
        planners = pk.planners
        self.robot, self.drive = pk.load_pepper(), pk.load_pepper(base="planar")
        self.arm = pk.load_robot(ONE_JOINT)
        self.stand, self.zero = self.robot.posture("Stand"), np.zeros(self.robot.n)
        self.raised = self.robot.joint_vector({"RShoulderPitch": 0.4, "RElbowRoll": 0.8})
        self.scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
        self.motion = pk.retime(self.robot, [self.stand, self.raised])
        self.task = pk.ik.HandPosition("left", (0.38, 0.22, 0.82))
        self.box = pk.model.Box((0.1, 0.1, 0.1))
        self.monitor = pk.twin.base.BalanceMonitor(self.robot)
        self.times, self.still = np.linspace(0, 0.1, 5), np.tile(self.stand, (5, 1))
        self.timeline = pk.files.naoqi_timeline(["HeadYaw"], [[0.5, 1.0]], [[0.1, 0.2]])
        self.free = lambda x: np.ones(len(x), dtype=bool)
        self.problem = planners.Problem([0, 0], [1, 1], [0.1, 0.1], [0.9, 0.9], self.free, resolution=0.05)
        self.path = planners.Path([[0.1, 0.1], [0.5, 0.9], [0.9, 0.9]])
        self.on_line = planners.Path(np.linspace(0.1, 0.9, 17)[:, None] * [1.0, 1.0])
        self.line = planners.ConstraintManifold(
            lambda x: (x[:, :1] - x[:, 1:], np.tile([[[1.0, -1.0]]], (len(x), 1, 1))), 2, 1
        )
        self.price = planners.StateCost(lambda x: (x[:, :1] ** 2, 2 * x[:, None, :] * [1.0, 0.0]), 2)
        self._temporary = tempfile.TemporaryDirectory()  # removed with this object
        self.folder = Path(self._temporary.name)
        pk.files.save(self.motion, self.folder / "motion.csv")
        pk.files.save_table({"time": self.times, "A.position": self.times}, self.folder / "table.csv")
        self.others = self._others()

    def _others(self) -> dict[type, list[Any]]:
        """Return objects of other robots and of other numbers of coordinates, by their type."""
        planners = pk.planners
        driven = pk.retime(self.drive, [self.drive.posture("Stand"), 0.9 * self.drive.posture("Stand")])
        turned = pk.retime(self.arm, [[0.0], [1.0]], acceleration_limits=1.0)
        cube = planners.Problem([0] * 3, [1] * 3, [0.1] * 3, [0.9] * 3, self.free, resolution=0.05)
        line = planners.ConstraintManifold(lambda x: (x[:, :1], x[:, None, :] * 0 + 1), 3, 1)
        paths = [planners.Path([[0.1] * 3, [0.9] * 3]), planners.Path([[0.1], [0.9]])]
        return {
            type(self.motion): [driven, turned], type(self.problem): [cube], type(self.path): paths,
            type(self.line): [line], type(self.monitor): [pk.twin.base.BalanceMonitor(self.drive)],
            type(self.price): [planners.StateCost(lambda x: (x[:, :1] ** 2, 2 * x[:, None, :]), 3)],
            type(self.timeline): [pk.files.naoqi_timeline(["none"], [[0.5, 1.0]], [[0.1, 0.2]])],
        }  # fmt: skip


def arguments(s: Samples) -> dict[str, Any]:
    """Return arguments by the names of parameters, for all functions that take them."""
    return {
        "pepper": s.robot, "q": s.stand, "v": s.zero, "a": s.zero, "tau": s.zero, "frame": "LArm_effector",
        "frames": ["LArm_effector", "CameraTop_frame"], "forces": {"LArm_effector": np.zeros(6)},
        "scene": s.scene, "start": s.stand, "goal": s.raised, "tasks": [s.task], "trajectory": s.motion,
        "path": [s.stand, s.raised], "points": np.array([[1.0, 0.0, 1.0], [2.0, 0.0, 1.0]]), "name": "head",
        "hand": "left", "target": np.eye(4), "point": np.array([0.38, 0.22, 0.82]), "value": 0.1, "yaw": 0.1,
        "direction": np.array([0.0, 0.0, 1.0]), "reference": "RArm_effector", "joint": "HeadYaw",
        "function": lambda q: q[0], "monitor": s.monitor, "twist": np.array([0.1, 0.0, 0.0]),
        "force": np.array([1.0, 0.0, 0.0]), "geometry": s.box, "position": np.array([1.0, 0.0, 0.5]),
        "size": np.full(3, 0.1), "mass": 0.5, "timeline": s.timeline, "rotation": np.eye(3), "within": 0.1,
        "rpy": np.array([0.1, 0.2, 0.3]), "quaternion": np.array([0.0, 0.0, 0.0, 1.0]), "edge": 0,
        "names": ["HeadYaw"], "times": [[0.5, 1.0]], "keys": [[0.1, 0.2]], "lower": -1.0, "upper": 1.0,
        "n": s.robot.n, "report": s.monitor.assess(s.times, s.still, 0 * s.still, 0 * s.still),
        "rate": 100.0, "dt": 0.01, "center": np.array([1.0, 0.0]), "duration": 4.0, "step": None, "count": 10,
        "samples": 1000, "resolution": 0.1, "problem": s.problem, "manifold": s.line, "cost": s.price,
        "states": np.array([[0.5, 0.5]]), "radius": 0.1, "length": 0.2, "end": np.array([1.0, 1.0, 0.5]),
        "timestep": 0.001, "weight": 1.0, "tolerance": 0.001, "restarts": 2, "starts": 8, "timeout": 5.0,
        "candidates": 8, "iterations": 20, "max_iterations": 50, "threads": 1, "seed": 0, "width": 64,
        "height": 48, "speed": 0.3, "acceleration": 0.3, "track": 0.3, "axis": np.array([0.0, 0.0, 1.0]),
    }  # fmt: skip


def of_functions(s: Samples) -> dict[str, dict[str, Any]]:
    """Return arguments that a single function takes in place of those above, or of its defaults."""
    planners, zero3, point = pk.planners, np.zeros(3), np.array([0.3, 0.2, 0.9])
    turning = ([-2, -2, -3.2], [2, 2, 3.2], [0, 0, 0], [1, 1, 0.5])
    rays, ends = np.ones(15), {"start": zero3, "end": np.array([1.0, 1.0, 0.5])}
    camera = {"name": "camera_top", "resolution": "QQVGA"}
    short = {"max_iterations": 3, "intervals": 6}
    return {
        "export": {"format": "urdf"}, "load_robot": {"urdf": s.robot.urdf, "srdf": None},
        "audit": {"source": s.robot}, "compare": {"first": s.robot, "second": s.robot},
        "Mesh": {"path": "part.stl"}, "Box": {"size": (0.1, 0.1, 0.1)}, "kernel": {"quantity": "mass_matrix"},
        "make_target": {"triple": "x86_64-unknown-linux-gnu", "cpu": "x86-64-v3", "features": ""},
        "source_digest": {"modules": "pepper_kin.model"}, "reach_map": {"resolution": 0.2},
        "FramePosition": {"target": point}, "FrameOrientation": {"target": np.eye(3)},
        "FrameInPlane": {"target": point}, "RelativePosition": {"target": 0.1 * point},
        "RelativeOrientation": {"target": np.eye(3)}, "CenterOfMass": {"point": np.zeros(2)},
        "BasePosition": {"point": np.array([0.1, 0.2])}, "LineThroughPoint": {"start": "RArm_effector"},
        "JointPosture": {"joints": None}, "Servo": {"rate": 100.0},
        "CenterOfMassOverWheels": {"margin": 0.01}, "BasePlacement": {"position": np.array([0.1, 0.2])},
        "solve_batch": {"tasks": [pk.ik.HandPosition("left", np.tile(point, (2, 1)))]},
        "placement_map": {"size": 0.5, "resolution": 0.25, "headings": 2},
        "gesture": {"name": "wave"}, "gesture_meaning": {"name": "wave"},
        "PathCost": {"function": lambda q: q[0] ** 2}, "Line": {"to": 0.1 * point, "relative": True},
        "Arc": {"center": point, "angle": 0.2}, "Leg": {"goal": [s.task]},
        "cartesian_path": {"curves": pk.motion.Line((0.0, 0.0, 0.03), relative=True), "step": 0.01},
        "interpolate_path": {"path": np.array([s.stand, s.raised]), "count": 5},
        "plan_costed": {"costs": [pk.motion.PathCost(s.robot, lambda q: q[0] ** 2)]},
        "plan_constrained": {"constraints": [pk.ik.JointValue("HipRoll", 0.0, tolerance=0.2)]},
        "plan_legs": {"legs": [pk.motion.Leg(s.raised)]}, "minimum_torque_trajectory": short,
        "optimize": short, "Cost": {"time": 1.0}, "OnlineMotion": {"v": 0.0, "a": 0.0},
        "retime": {"jerk": None}, "phase_plane": {"points": 50}, "Key": {"time": 0.5},
        "JointCurve": {"keys": (pk.trajectory.Key(0.5, 0.1),)},
        "Timeline": {"name": "keys", "curves": s.timeline.curves},
        "Trajectory": {name: getattr(s.motion, name) for name in ("breaks", "coefficients", "joint_names")},
        "Path": {"points": s.path.points}, "Metric": {"weights": np.array([1.0, 2.0])},
        "aorrtc": {"path": None, "timeout": 0.2}, "rounded_waypoints": {"path": s.path, "segments": 5},
        **{name: {"path": s.path} for name in ("shortcut", "smooth", "certify", "descend_cost")},
        **{name: {"path": s.on_line} for name in ("constrained_shortcut", "constrained_smooth")},
        "rejoin": {"path": s.path, "goal": 0}, "car_curve": {**ends, "radius": 0.3},
        "first_invalid_states": {"count": 3}, "first_blocked_states": {"count": 3},
        "Problem": {"lower": np.zeros(2), "upper": np.ones(2), "start": np.full(2, 0.1),
                    "goals": np.full((1, 2), 0.9), "validity": s.free},
        "ConstraintManifold": {"function": s.line.function, "n": 2, "rows": 1},
        "StateCost": {"function": s.price.function, "n": 2},
        "MotionValidator": {"valid": s.free, "metric": planners.Metric([1.0, 1.0])},
        "car_connect": {"radius": 0.3, "problem": planners.Problem(
            *turning, s.free, weights=(1.0, 1.0, 0.2), resolution=0.05)},
        "TwinBatch": {"count": 3}, "Twin": {"world": None, "sensors": None},
        "replay": {"duration": None}, "Camera": camera, "camera_intrinsics": camera,
        "Intrinsics": {"fx": 60.0, "fy": 60.0, "cx": 32.0, "cy": 24.0},
        "arc_between": ends, "arc_moved": {"pose": zero3, "arc": np.array([0.1, 0.0, 0.1])},
        "Odometry": {"base": pk.twin.base.OmniBase()}, "BaseController": {"base": pk.twin.base.OmniBase()},
        "OmniBase": {"base": s.robot}, "simulate_tipping": {"q": s.still}, "edge_moments": {"q": s.still},
        "World": {"pepper": s.drive}, "published_scan": {"right": rays, "left": rays, "front": rays},
        "RayCaster": {"geometries": [s.box], "poses": np.eye(4)[None]}, "RobotRays": {"pepper": s.drive},
        "SensorSuite": {"pepper": s.drive}, "save": {"path": s.folder / "out.csv"},
        "load": {"path": s.folder / "motion.csv"}, "load_table": {"path": s.folder / "table.csv"},
        "save_table": {"path": s.folder / "b.csv", "columns": {"time": s.times, "A.position": s.times}},
        "load_columns": {"path": s.folder / "columns.json"}, "HalfSpace": {"offset": 0.1},
        "ConvexMesh": {"vertices": np.vstack([np.eye(3), zero3])}, "PointCloud": {"radius": 0.01},
        "TriangleMesh": {"vertices": np.eye(3), "faces": np.array([[0, 1, 2]])},
        "least_clearance": {"q": s.still},
    }  # fmt: skip


def of_models_and_scenes(s: Samples) -> Methods:
    """Return objects of `model`, `collision`, `kinematics`, `batch` and `base_placement`."""
    q, points = s.stand, np.vstack([np.eye(3), np.zeros(3)])
    place, faces = np.array([1.0, 0.0, 0.5]), np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])
    reach = pk.kinematics.reach_map(s.robot, "LArm_effector", resolution=0.2, samples=1000)
    places = pk.base_placement.placement_map(
        s.drive, [s.task], center=(0.0, 0.0), size=0.4, resolution=0.2, headings=2
    )
    mass = pk.batch.kernel(s.robot, "mass_matrix")
    return {
        "PepperModel": (lambda: s.robot, {
            "joint_vector": {"values": q, "rest": q}, "with_limits": {"velocity": np.ones(s.robot.n)},
            "with_masses": {"masses": {"Head": 2.0}},
        }),
        "CollisionChecker": (lambda: pk.collision.CollisionChecker(s.robot, s.scene), {
            **{name: {"q": q} for name in ("clearance", "closest_pair", "contacts", "in_collision")},
            "contact_points": {"q": q, "within": 0.1}, "with_margins": {"margin": 0.01, "self_margin": 0.01},
        }),
        "Scene": (lambda: s.scene, {
            "add": {"name": "a", "geometry": s.box, "position": place, "rpy": np.zeros(3)},
            "add_capsule": {"name": "a", "radius": 0.1, "length": 0.2, "position": place},
            "add_convex_mesh": {"name": "a", "vertices": points, "position": place, "scale": np.ones(3)},
            "add_mesh": {"name": "a", "vertices": points, "faces": faces, "position": place},
            "add_half_space": {"name": "a", "normal": np.array([0.0, 0.0, 1.0]), "offset": -1.0},
            "add_point_cloud": {"name": "a", "points": points, "radius": 0.01, "position": place},
            "move": {"name": "table", "position": place, "rpy": np.zeros(3)}, "padded": {"margin": 0.01},
            "attach": {"name": "table", "frame": "LArm_effector", "pepper": s.robot, "q": q, "mass": 0.1},
        }),
        "ReachMap": (lambda: reach, {"contains": {"points": np.array([[0.3, 0.2, 0.9]])}}),
        "PlacementMap": (lambda: places, {"score_at": {"point": np.array([0.0, 0.0])}}),
        "Kernel": (lambda: by_name(mass), {"__call__": {"a": np.tile(q, (5, 1)), "out": None, "threads": 1}}),
    }  # fmt: skip


def by_name(kernel: Any) -> Any:
    """Return an object that is called as a kernel of one input is, with a name for this."""

    class Named:
        def __call__(self, a: Any, out: Any = None, threads: int = 1) -> Any:
            return kernel(a, out=out, threads=threads)

    return Named()


def of_motions(s: Samples) -> Methods:
    """Return objects of `servo`, `motion` and `trajectory`."""
    at, price = {"t": np.array([0.1, 0.2])}, pk.motion.PathCost(s.robot, lambda q: q[0] ** 2)
    inside = {"segment": np.array([0, 1]), "local_time": np.array([0.01, 0.01])}
    return {
        "Servo": (lambda: pk.servo.Servo(s.robot, s.stand),
                  {"set_target": {"tasks": [s.task]}, "set_scene": {"scene": s.scene}}),
        "PathCost": (lambda: price, {"values": {"q": np.tile(s.stand, (3, 1))}}),
        "Trajectory": (lambda: s.motion, {
            "__call__": at, "jerk": at, "at_segments": inside, "jerk_at_segments": inside,
            "active_limits": {"pepper": s.robot, **at}, "check": {"pepper": s.robot, "scene": s.scene},
            "blend": {"other": s.motion.reversed(), "overlap": 0.1}, "is_close": {"other": s.motion},
            "scaled": {"factor": 2.0}, "with_duration": {"duration": 5.0}, "sample": {"dt": 0.01},
            "between": {"start": 0.1, "end": 0.3},
        }),
        "OnlineMotion": (lambda: pk.trajectory.OnlineMotion(s.robot, s.stand),
                         {"set_target": {"q_target": s.raised, "v_target": s.zero}, "step": {"dt": 0.01}}),
        "Timeline": (lambda: s.timeline, {"to_trajectory": {"pepper": s.robot, "start": s.stand}}),
    }  # fmt: skip


def of_planners(s: Samples) -> Methods:
    """Return objects of `planners`, in the plane."""
    states, along = np.array([[0.2, 0.2], [0.5, 0.5]]), {"s": np.array([0.1, 0.2])}
    ends, metric = {"start": np.full(2, 0.2), "goals": np.full((1, 2), 0.8)}, pk.planners.Metric([1.0, 2.0])
    smooth = pk.planners.smooth(s.problem, s.path)
    curve = pk.planners.car_curve(np.zeros(3), np.array([1.0, 1.0, 0.5]), 0.3)
    return {
        "Metric": (lambda: metric,
                   {"distance": {"a": states, "b": states}, "arc_lengths": {"points": states}}),
        "Path": (lambda: s.path, {"__call__": along, "edge_index": along, "resample": {"spacing": 0.1}}),
        "SmoothPath": (lambda: smooth, {"__call__": along, "sample": {"spacing": 0.1}}),
        "Problem": (lambda: s.problem, {"begun_at": ends, "resolved": {"resolution": 0.1}}),
        "MotionValidator": (lambda: s.problem.validator(), {
            "states_valid": {"states": states},
            "last_valid_step": {"a": states[0], "b": states[1], "steps": 5},
        }),
        "Roadmap": (lambda: pk.planners.Roadmap(s.problem), {"solve": ends, "grow": {"nodes": 20}}),
        "ConstraintManifold": (lambda: s.line,
                               {name: {"states": states} for name in ("contains", "errors", "worst")}),
        "StateCost": (lambda: s.price, {"at": {"states": states}, "along": {"path": s.path}}),
        "CarCurve": (lambda: curve, {"__call__": along, "part": {"begin": 0.1, "end": 0.2}}),
    }  # fmt: skip


def of_twins(s: Samples) -> Methods:
    """Return objects of `twin` and of what is in it."""
    q, v, still, base, twin = s.stand, s.zero, s.still, pk.twin.base.OmniBase(), pk.twin
    target = {"position": q, "velocity": v, "acceleration": v, "effort": v, "load": v}
    run, many = {name: np.tile(value, (5, 1)) for name, value in target.items()}, np.tile(q, (3, 1))
    command = {"q": q, "v": v, "q_ref": q, "v_ref": v, "feedforward": v}
    turns, motors = {"wheel_speeds": np.ones(3)}, pk.Twin(s.robot).actuators
    rays = {"origins": np.zeros((4, 3)), "directions": np.eye(3)[[0, 1, 2, 0]]}
    poses = np.tile(np.eye(4), (2, 1, 1))
    looked, around = {"q": q, "scene": s.scene, **rays}, twin.sensors.RobotRays(s.robot)
    eye = twin.sensors.Camera(s.robot, "camera_top", "QQVGA")
    ball = {"radius": 0.05, "mass": 0.2, "position": np.array([2.0, 0.0, 1.0]), "velocity": np.zeros(6)}
    box = {"size": np.full(3, 0.1), "mass": 0.2, "position": ball["position"], "rpy": np.zeros(3)}
    return {
        "Twin": (lambda: pk.Twin(s.robot), {
            "step": target, "follow": run, "reset": {"q": q, "v": v}, "execute": {"trajectory": s.motion},
            "push": {"frame": "LArm_effector", "force": np.ones(3), "point": np.zeros(3), "duration": 0.1},
        }),
        "TwinBatch": (lambda: pk.TwinBatch(s.robot, 3), {
            "follow": {**run, "every": 1}, "execute": {"trajectory": s.motion, "every": 50},
            "reset": {"q": many, "v": 0 * many, "rows": np.array([0, 1, 2])},
        }),
        "Integrator": (lambda: twin.Integrator(s.robot, 0.001, motors), {
            "step": {**command, "load": v}, "linearized": {**command, "load": v},
            "present_torque": command, "gravity_torque": {"q": q},
            "run": {"q": q, "v": v, "command": twin.integrator.Command(still, 0 * still, 0 * still),
                    "load": 0 * still, "every": 1},
        }),
        "BalanceMonitor": (lambda: s.monitor,
                           {"assess": {"time": s.times, "q": still, "v": 0 * still, "a": 0 * still}}),
        "OmniBase": (lambda: base, {
            "body_twist": turns, "wheel_slip": {"twist": np.ones(3), **turns},
            "wheel_speeds": {"twist": np.ones(3)}, "limited": {"twist": np.ones(3)},
        }),
        "Odometry": (lambda: twin.base.Odometry(base), {"add": {"turns": np.ones(3)}}),
        "BaseController": (lambda: twin.base.BaseController(base), {
            "command": {"twist": np.zeros(3)}, "reset": {"pose": np.zeros(3)}, "step": {"timestep": 0.01},
        }),
        "RayCaster": (lambda: twin.sensors.RayCaster([s.box, s.box], poses), {
            "cast": {**rays, "maximum": np.full(4, 5.0)}, "distances": rays, "place": {"poses": poses},
        }),
        "RobotRays": (lambda: around, {"look": looked, "distances": looked}),
        "Camera": (lambda: eye, {
            "depth": {"q": q, "scene": s.scene}, "project": {"q": q, "points": np.array([[1.0, 0.0, 1.0]])},
        }),
        "SensorSuite": (lambda: twin.sensors.SensorSuite(s.robot), {
            "read": {"time": 0.0, "q": q, "v": v, "a": v, "torque": v, "scene": s.scene},
        }),
        "World": (lambda: twin.world.World(s.drive, s.scene),
                  {"add_ball": {"name": "a", **ball}, "add_box": {"name": "a", **box}}),
    }  # fmt: skip


METHODS = {f.__name__: f for f in (of_models_and_scenes, of_motions, of_planners, of_twins)}


class Values:
    """Arguments that work, by the name of a parameter; those of a single function go first."""

    def __init__(self) -> None:
        self.samples = Samples()
        self.named, self.special = arguments(self.samples), of_functions(self.samples)

    def of(self, owner: str, parameter: inspect.Parameter) -> Any:
        """Return a valid argument, or the parameter's default, or `inspect.Parameter.empty`."""
        special = self.special.get(owner, {})
        if parameter.name in special:
            return special[parameter.name]
        if parameter.default is not parameter.empty and parameter.name not in KEEP_SHORT:
            return parameter.default
        return self.named.get(parameter.name, parameter.default)

    def others(self, valid: Any) -> list[Any]:
        """Return objects of the kind of a valid argument, but of other sizes: of another robot, say."""
        s = self.samples
        if valid is s.robot or valid is s.drive:
            return [robot for robot in (s.drive, s.robot, s.arm) if robot is not valid]
        return s.others.get(type(valid), [])
