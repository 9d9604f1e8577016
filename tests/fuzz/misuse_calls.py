"""Arguments that work for single functions, by subject: `Function.parameter` -> value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

import pepper_kin as pk

if TYPE_CHECKING:
    from misuse_values import Samples


def model_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for models, their quantities, and machine code."""
    return {
        "export.format": "urdf",
        "load_robot.urdf": s.robot.urdf,
        "load_robot.srdf": None,
        "audit.source": s.robot,
        "compare.first": s.robot,
        "compare.second": s.robot,
        "Mesh.path": "part.stl",
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
        "frame_pose.frame": "LArm_effector",
        "named_axes.q": s.stand,
        "make_target.triple": "x86_64-unknown-linux-gnu",
        "make_target.cpu": "x86-64-v3",
        "make_target.features": "",
        "source_digest.modules": "pepper_kin.model",
        "reach_map.resolution": 0.2,
    }


def ik_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for inverse kinematics, and places to stand."""
    return {
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
        "Servo.rate": 100.0,
        "CenterOfMassOverWheels.margin": 0.01,
        "BasePlacement.position": np.array([0.1, 0.2]),
        "solve_batch.tasks": [pk.ik.HandPosition("left", np.array([[0.3, 0.2, 0.9]] * 2))],
        "placement_map.center": np.array([1.0, 0.0]),
        "placement_map.size": 0.5,
        "placement_map.resolution": 0.25,
        "placement_map.headings": 2,
    }


def motion_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for planning and optimization."""
    return {
        "gesture.name": "wave",
        "gesture_meaning.name": "wave",
        "PathCost.function": lambda q: q[0] ** 2,
        "Line.to": np.array([0.1, 0.0, 0.0]),
        "Line.relative": True,
        "Arc.center": np.array([0.3, 0.2, 0.9]),
        "Arc.axis": np.array([0.0, 0.0, 1.0]),
        "Arc.angle": 0.2,
        "cartesian_path.curves": pk.motion.Line((0.0, 0.0, 0.03), relative=True),
        "Leg.goal": [s.task],
        "cartesian_path.step": 0.01,
        "interpolate_path.path": np.array([s.stand, s.raised]),
        "interpolate_path.count": 5,
        "plan_costed.costs": [pk.motion.PathCost(s.robot, lambda q: q[0] ** 2)],
        "plan_constrained.constraints": [pk.ik.JointValue("HipRoll", 0.0, tolerance=0.2)],
        "plan_legs.legs": [pk.motion.Leg(s.raised)],
        "minimum_torque_trajectory.duration": 4.0,
        "minimum_torque_trajectory.max_iterations": 3,
        "optimize.max_iterations": 3,
        "optimize.intervals": 6,
        "minimum_torque_trajectory.intervals": 6,
        "Cost.time": 1.0,
        "validate.path": [s.stand, s.raised],
        "simplify_path.path": [s.stand, s.raised],
        "optimize.path": [s.stand, s.raised],
        "plan.timeout": 5.0,
        "PlanProblem.start": s.stand,
    }


def trajectory_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for trajectories and key frames."""
    return {
        "OnlineMotion.q": s.stand,
        "OnlineMotion.v": 0.0,
        "OnlineMotion.a": 0.0,
        "retime.jerk": None,
        "phase_plane.points": 50,
        "Key.time": 0.5,
        "Key.value": 0.1,
        "JointCurve.joint": "HeadYaw",
        "JointCurve.keys": (pk.trajectory.Key(0.5, 0.1),),
        "Timeline.name": "keys",
        "Timeline.curves": s.timeline.curves,
        "Trajectory.breaks": s.motion.breaks,
        "Trajectory.coefficients": s.motion.coefficients,
        "Trajectory.joint_names": s.motion.joint_names,
    }


def planners_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for planners on vectors."""
    return {
        "Path.points": s.path.points,
        "Metric.weights": np.array([1.0, 2.0]),
        "aorrtc.path": None,
        "aorrtc.timeout": 0.2,
        "shortcut.path": s.path,
        "smooth.path": s.path,
        "certify.path": s.path,
        "rejoin.path": s.path,
        "rejoin.goal": 0,
        "rounded_waypoints.path": s.path,
        "rounded_waypoints.segments": 5,
        "constrained_shortcut.path": s.on_line,
        "constrained_smooth.path": s.on_line,
        "descend_cost.path": s.path,
        "car_curve.start": np.zeros(3),
        "car_curve.end": np.array([1.0, 1.0, 0.5]),
        "first_invalid_states.count": 3,
        "first_blocked_states.count": 3,
        "Problem.lower": np.zeros(2),
        "Problem.upper": np.ones(2),
        "Problem.start": np.full(2, 0.1),
        "Problem.goals": np.full((1, 2), 0.9),
        "Problem.validity": s.free,
        "Roadmap.problem": s.problem,
        "ConstraintManifold.function": s.line.function,
        "ConstraintManifold.n": 2,
        "ConstraintManifold.rows": 1,
        "StateCost.function": s.price.function,
        "StateCost.n": 2,
        "MotionValidator.valid": s.free,
        "MotionValidator.metric": pk.planners.Metric([1.0, 1.0]),
        "MotionValidator.resolution": 0.1,
        "car_connect.problem": pk.planners.Problem(
            [-2, -2, -3.2],
            [2, 2, 3.2],
            [0, 0, 0],
            [1, 1, 0.5],
            s.free,
            weights=(1.0, 1.0, 0.2),
            resolution=0.05,
        ),
    }


def twin_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for the twin, its base and sensors."""
    return {
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
        "OmniBase.base": s.robot,
        "simulate_tipping.q": s.still,
        "edge_moments.q": s.still,
        "World.pepper": s.drive,
        "published_scan.right": np.ones(15),
        "published_scan.left": np.ones(15),
        "published_scan.front": np.ones(15),
        "RayCaster.geometries": [s.box],
        "RayCaster.poses": np.eye(4)[None],
        "RobotRays.pepper": s.drive,
        "SensorSuite.pepper": s.drive,
        "world_velocity.yaw": 0.2,
    }


def files_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for files."""
    return {
        "save.path": s.folder / "out.csv",
        "load.path": s.folder / "motion.csv",
        "save_table.path": s.folder / "out_table.csv",
        "save_table.columns": {"time": s.times, "A.position": s.times},
        "load_table.path": s.folder / "table.csv",
        "load_columns.path": s.folder / "columns.json",
    }


def collision_calls(s: Samples) -> dict[str, Any]:
    """Return arguments for scenes and their shapes."""
    return {
        "HalfSpace.offset": 0.1,
        "ConvexMesh.vertices": np.vstack([np.eye(3), np.zeros(3)]),
        "PointCloud.radius": 0.01,
        "TriangleMesh.vertices": np.eye(3),
        "TriangleMesh.faces": np.array([[0, 1, 2]]),
        "least_clearance.q": s.still,
    }


SUBJECTS = (
    model_calls,
    ik_calls,
    motion_calls,
    trajectory_calls,
    planners_calls,
    twin_calls,
    files_calls,
    collision_calls,
)
