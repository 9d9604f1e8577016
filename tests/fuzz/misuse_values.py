"""Calls that work: an argument for every parameter of the public functions."""

from __future__ import annotations

import inspect
import tempfile
from pathlib import Path
from typing import Any

import numpy as np


class Values:
    """Arguments that work, by the name of a parameter; `Function.parameter` goes first."""

    def __init__(self) -> None:
        import pepper_kin as pk

        robot, drive = pk.load_pepper(), pk.load_pepper(base="planar")
        stand = robot.posture("Stand")
        n, zero = robot.n, np.zeros(robot.n)
        raised = robot.joint_vector({"RShoulderPitch": 0.4, "RElbowRoll": 0.8})
        scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
        motion = pk.retime(robot, [stand, raised])
        task = pk.ik.HandPosition("left", (0.38, 0.22, 0.82))
        box, disk = pk.model.Box((0.1, 0.1, 0.1)), pk.planners
        free = lambda x: np.ones(len(x), dtype=bool)  # noqa: E731
        problem = disk.Problem([0.0, 0.0], [1.0, 1.0], [0.1, 0.1], [0.9, 0.9], free, resolution=0.05)
        path = disk.Path([[0.1, 0.1], [0.5, 0.9], [0.9, 0.9]])
        line = disk.ConstraintManifold(
            lambda x: (x[:, :1] - x[:, 1:], np.tile([[[1.0, -1.0]]], (len(x), 1, 1))), 2, 1
        )
        price = disk.StateCost(lambda x: (x[:, :1] ** 2, 2 * x[:, None, :] * [1.0, 0.0]), 2)
        on_line = disk.Path(np.linspace(0.1, 0.9, 17)[:, None] * [1.0, 1.0])
        monitor = pk.twin.base.BalanceMonitor(robot)
        times = np.linspace(0, 0.1, 5)
        still = np.tile(stand, (5, 1))
        folder = Path(tempfile.mkdtemp())
        pk.files.save(motion, folder / "motion.csv")
        pk.files.save_table({"time": times, "A.position": times}, folder / "table.csv")
        timeline = pk.files.naoqi_timeline(["HeadYaw"], [[0.5, 1.0]], [[0.1, 0.2]])
        self.robot, self.motion, self.scene = robot, motion, scene
        self.named: dict[str, Any] = {
            "pepper": robot,
            "q": stand,
            "v": zero,
            "a": zero,
            "tau": zero,
            "frame": "LArm_effector",
            "frames": ["LArm_effector", "CameraTop_frame"],
            "forces": {"LArm_effector": np.zeros(6)},
            "scene": scene,
            "start": stand,
            "goal": raised,
            "tasks": [task],
            "trajectory": motion,
            "path": [stand, raised],
            "within": 0.1,
            "points": np.array([[1.0, 0.0, 1.0], [2.0, 0.0, 1.0]]),
            "name": "head",
            "hand": "left",
            "target": np.eye(4),
            "point": np.array([0.38, 0.22, 0.82]),
            "direction": np.array([0.0, 0.0, 1.0]),
            "reference": "RArm_effector",
            "joint": "HeadYaw",
            "value": 0.1,
            "yaw": 0.1,
            "function": lambda q: q[0],
            "rate": 100.0,
            "dt": 0.01,
            "center": np.array([1.0, 0.0]),
            "duration": 4.0,
            "step": None,
            "count": 10,
            "samples": 1000,
            "resolution": 0.1,
            "problem": problem,
            "manifold": line,
            "cost": price,
            "states": np.array([[0.5, 0.5]]),
            "radius": 0.3,
            "end": np.array([1.0, 1.0, 0.5]),
            "timestep": 0.001,
            "monitor": monitor,
            "twist": np.array([0.1, 0.0, 0.0]),
            "force": np.array([1.0, 0.0, 0.0]),
            "geometry": box,
            "position": np.array([1.0, 0.0, 0.5]),
            "size": np.array([0.1, 0.1, 0.1]),
            "mass": 0.5,
            "timeline": timeline,
            "rotation": np.eye(3),
            "rpy": np.array([0.1, 0.2, 0.3]),
            "weight": 1.0,
            "quaternion": np.array([0.0, 0.0, 0.0, 1.0]),
            "tolerance": 1e-3,
            "edge": 0,
            "names": ["HeadYaw"],
            "times": [[0.5, 1.0]],
            "keys": [[0.1, 0.2]],
            "lower": -1.0,
            "upper": 1.0,
            "n": n,
            "report": monitor.assess(times, still, 0 * still, 0 * still),
            "restarts": 2,
            "starts": 8,
            "timeout": 5.0,
            "candidates": 8,
            "iterations": 20,
            "max_iterations": 50,
            "threads": 1,
            "seed": 0,
            "width": 64,
            "height": 48,
        }
        self.special: dict[str, Any] = {
            "gesture.name": "wave",
            "gesture_meaning.name": "wave",
            "export.format": "urdf",
            "load_robot.urdf": robot.urdf,
            "load_robot.srdf": None,
            "audit.source": robot,
            "compare.first": robot,
            "compare.second": robot,
            "HandPose.target": np.eye(4),
            "FramePosition.target": np.array([0.3, 0.2, 0.9]),
            "FrameOrientation.target": np.eye(3),
            "FrameInPlane.target": np.array([0.3, 0.2, 0.9]),
            "RelativePosition.target": np.array([0.1, 0.0, 0.0]),
            "RelativeOrientation.target": np.eye(3),
            "CenterOfMass.point": np.array([0.0, 0.0]),
            "BasePosition.point": np.array([0.1, 0.2]),
            "LineThroughPoint.start": "RArm_effector",
            "JointPosture.joints": None,
            "PathCost.function": lambda q: q[0] ** 2,
            "Servo.rate": 100.0,
            "OnlineMotion.q": stand,
            "Line.to": np.array([0.1, 0.0, 0.0]),
            "Line.relative": True,
            "Arc.center": np.array([0.3, 0.2, 0.9]),
            "Arc.axis": np.array([0.0, 0.0, 1.0]),
            "Arc.angle": 0.2,
            "cartesian_path.curves": pk.motion.Line((0.0, 0.0, 0.03), relative=True),
            "Leg.goal": [task],
            "cartesian_path.step": 0.01,
            "interpolate_path.path": np.array([stand, raised]),
            "interpolate_path.count": 5,
            "plan_costed.costs": [pk.motion.PathCost(robot, lambda q: q[0] ** 2)],
            "plan_constrained.constraints": [pk.ik.JointValue("HipRoll", 0.0, tolerance=0.2)],
            "plan_legs.legs": [pk.motion.Leg(raised)],
            "minimum_torque_trajectory.duration": 4.0,
            "minimum_torque_trajectory.max_iterations": 3,
            "optimize.max_iterations": 3,
            "optimize.intervals": 6,
            "minimum_torque_trajectory.intervals": 6,
            "Path.points": path.points,
            "Metric.weights": np.array([1.0, 2.0]),
            "aorrtc.path": None,
            "aorrtc.timeout": 0.2,
            "shortcut.path": path,
            "smooth.path": path,
            "certify.path": path,
            "rejoin.path": path,
            "rejoin.goal": 0,
            "rounded_waypoints.path": path,
            "rounded_waypoints.segments": 5,
            "constrained_shortcut.path": on_line,
            "constrained_smooth.path": on_line,
            "descend_cost.path": path,
            "car_curve.start": np.zeros(3),
            "car_curve.end": np.array([1.0, 1.0, 0.5]),
            "first_invalid_states.count": 3,
            "first_blocked_states.count": 3,
            "Problem.lower": np.zeros(2),
            "Problem.upper": np.ones(2),
            "Problem.start": np.full(2, 0.1),
            "Problem.goals": np.full((1, 2), 0.9),
            "Problem.validity": free,
            "Roadmap.problem": problem,
            "ConstraintManifold.function": line.function,
            "ConstraintManifold.n": 2,
            "ConstraintManifold.rows": 1,
            "StateCost.function": price.function,
            "StateCost.n": 2,
            "MotionValidator.valid": free,
            "MotionValidator.metric": disk.Metric([1.0, 1.0]),
            "MotionValidator.resolution": 0.1,
            "car_connect.problem": disk.Problem(
                [-2, -2, -3.2],
                [2, 2, 3.2],
                [0, 0, 0],
                [1, 1, 0.5],
                free,
                weights=(1.0, 1.0, 0.2),
                resolution=0.05,
            ),
            "TwinBatch.count": 3,
            "Twin.world": None,
            "Twin.sensors": None,
            "Push.force": np.array([1.0, 0.0, 0.0]),
            "Push.point": np.zeros(3),
            "Push.start": 0.0,
            "Push.duration": 0.1,
            "replay.name": "head",
            "paper_gesture.name": "head",
            "replay.duration": None,
            "Camera.name": "camera_top",
            "Camera.resolution": "QQVGA",
            "camera_intrinsics.name": "camera_top",
            "camera_intrinsics.resolution": "QQVGA",
            "Intrinsics.fx": 60.0,
            "Intrinsics.fy": 60.0,
            "Intrinsics.cx": 32.0,
            "Intrinsics.cy": 24.0,
            "arc_between.start": np.zeros(3),
            "arc_between.end": np.array([0.3, 0.1, 0.2]),
            "arc_moved.pose": np.zeros(3),
            "arc_moved.arc": np.array([0.1, 0.0, 0.1]),
            "Odometry.base": pk.twin.base.OmniBase(),
            "BaseController.base": pk.twin.base.OmniBase(),
            "OmniBase.base": robot,
            "simulate_tipping.q": still,
            "edge_moments.q": still,
            "World.pepper": drive,
            "published_scan.right": np.ones(15),
            "published_scan.left": np.ones(15),
            "published_scan.front": np.ones(15),
            "RayCaster.geometries": [box],
            "RayCaster.poses": np.eye(4)[None],
            "save.path": folder / "out.csv",
            "load.path": folder / "motion.csv",
            "save_table.path": folder / "out_table.csv",
            "save_table.columns": {"time": times, "A.position": times},
            "load_table.path": folder / "table.csv",
            "load_columns.path": folder / "columns.json",
            "HalfSpace.offset": 0.1,
            "ConvexMesh.vertices": np.vstack([np.eye(3), np.zeros(3)]),
            "PointCloud.radius": 0.01,
            "Mesh.path": "part.stl",
            "TriangleMesh.vertices": np.eye(3),
            "TriangleMesh.faces": np.array([[0, 1, 2]]),
            "Cylinder.radius": 0.1,
            "Cylinder.length": 0.2,
            "Capsule.radius": 0.1,
            "Capsule.length": 0.2,
            "Sphere.radius": 0.1,
            "Box.size": (0.1, 0.1, 0.1),
            "Wheels.speed": 0.3,
            "Wheels.acceleration": 0.3,
            "Wheels.track": 0.3,
            "kernel.quantity": "mass_matrix",
            "RobotRays.pepper": drive,
            "SensorSuite.pepper": drive,
            "OnlineMotion.v": 0.0,
            "OnlineMotion.a": 0.0,
            "retime.jerk": None,
            "phase_plane.points": 50,
            "Key.time": 0.5,
            "Key.value": 0.1,
            "JointCurve.joint": "HeadYaw",
            "JointCurve.keys": (pk.trajectory.Key(0.5, 0.1),),
            "Timeline.name": "keys",
            "Timeline.curves": timeline.curves,
            "CenterOfMassOverWheels.margin": 0.01,
            "BasePlacement.position": np.array([0.1, 0.2]),
            "least_clearance.q": still,
            "solve_batch.tasks": [pk.ik.HandPosition("left", np.array([[0.3, 0.2, 0.9]] * 2))],
            "Cost.time": 1.0,
            "validate.path": [stand, raised],
            "simplify_path.path": [stand, raised],
            "optimize.path": [stand, raised],
            "plan.timeout": 5.0,
            "frame_pose.frame": "LArm_effector",
            "PlanProblem.start": stand,
            "named_axes.q": stand,
            "world_velocity.yaw": 0.2,
            "Trajectory.breaks": motion.breaks,
            "Trajectory.coefficients": motion.coefficients,
            "Trajectory.joint_names": motion.joint_names,
            "make_target.triple": "x86_64-unknown-linux-gnu",
            "make_target.cpu": "x86-64-v3",
            "make_target.features": "",
            "source_digest.modules": "pepper_kin.model",
            "placement_map.center": np.array([1.0, 0.0]),
            "placement_map.size": 0.5,
            "placement_map.resolution": 0.25,
            "placement_map.headings": 2,
            "reach_map.resolution": 0.2,
        }

    def of(self, owner: str, parameter: inspect.Parameter) -> Any:
        """Return a valid argument, or the parameter's default, or `inspect.Parameter.empty`."""
        special = f"{owner}.{parameter.name}"
        if special in self.special:
            return self.special[special]
        if parameter.default is not parameter.empty and parameter.name not in KEEP_SHORT:
            return parameter.default
        return self.named.get(parameter.name, parameter.default)


KEEP_SHORT = ("samples", "candidates", "restarts", "starts", "timeout", "iterations", "max_iterations")
"""Options whose defaults would take long; the short value goes in their place."""
