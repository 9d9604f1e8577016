"""What the results of readers must be: finite, ordered, of one length."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

import pepper_kin as pk
from pepper_kin import datasets
from pepper_kin.collision import Scene
from pepper_kin.datasets import DatasetJob
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import ReachMap
from pepper_kin.learning import Policy
from pepper_kin.model import FORMATS, load_robot
from pepper_kin.model.dynamics_model import MOST_COMPUTED
from pepper_kin.motion import KeyPoints
from pepper_kin.ros_messages import Bag, decode, encode
from pepper_kin.trajectory import Trajectory
from pepper_kin.twin import load_recording


class WrongResultError(Exception):
    """What a reader returned is not what a reader may return."""


def require(fact: object, what: str) -> None:
    """Raise where a result is not sound."""
    if not fact:
        raise WrongResultError(what)


def finite(*arrays: Any) -> None:
    """Require finite numbers."""
    for array in arrays:
        values = np.asarray(array)
        if values.dtype.kind not in "fiub" or not np.isfinite(values).all():
            raise WrongResultError(f"numbers {str(array)[:60]}")


def robot(model: pk.PepperModel) -> None:
    """Require ordered limits, finite places and masses, and exports that are texts or refusals."""
    lower, upper = model.lower_limits, model.upper_limits
    require(model.n > 0 and not np.isnan(lower).any() and (lower <= upper).all(), "limits")
    for limits in (model.velocity_limits, model.acceleration_limits, model.effort_limits):
        require((limits >= 0).all(), "a limit below zero")
    finite(
        model.full_map,
        model.full_offset,
        model.neutral(),
        model.posture(model.posture_names[0]) if model.posture_names else 0.0,
    )
    inner = model.inner_model
    for placement, inertia in zip(inner.jointPlacements, inner.inertias, strict=True):
        finite(placement.homogeneous, inertia.matrix())
    for shape in (*model.visual_shapes, *model.collision_shapes):
        finite(shape.transform_shape_to_link, shape.color)
    if len(model.full_offset) > MOST_COMPUTED:
        return
    finite(*pk.kinematics.frame_poses(model, model.neutral(), model.frame_names[:50]))
    finite(pk.dynamics.inverse_dynamics(model, model.neutral(), np.zeros(model.n), np.zeros(model.n)))
    for group in model.group_names:
        model.joint_group(group)


def exports(model: pk.PepperModel) -> None:
    """Require that each export is a text that reads back, or the library's refusal."""
    for format in FORMATS:
        try:
            text = model.export(format)
            text.encode()
        except pk.PepperKinError:
            continue
        if format == "urdf":
            again = load_robot(text)
            require(again.joint_names == model.joint_names, "an export of other joints")
            require(np.array_equal(again.lower_limits, model.lower_limits), "an export of other limits")


def report(found: Any) -> None:
    """Require an audit or comparison that can be printed and written."""
    found.report().encode("utf-8", "replace")
    json.dumps(found.to_dict(), default=str)


def motion(trajectory: Any) -> None:
    """Require a trajectory of finite numbers, or a run."""
    if isinstance(trajectory, Trajectory):
        finite(trajectory.breaks, trajectory.coefficients)
        require(trajectory.breaks[0] == 0.0 and (np.diff(trajectory.breaks) > 0).all(), "times")
    else:
        run(trajectory)


def run(found: Any) -> None:
    """Require a run of finite numbers and of one length."""
    finite(found.time, found.position, found.velocity, found.torque)
    require(len(found.time) == len(found.position) == len(found.velocity) == len(found.torque), "lengths")


def timelines(found: Any) -> None:
    """Require curves of finite keys."""
    for timeline in found if isinstance(found, tuple) else (found,):
        for curve in timeline.curves:
            finite([key.time for key in curve.keys], [key.value for key in curve.keys])
            require(isinstance(curve.joint, str), "a joint's name")


def table(columns: dict[str, Any]) -> None:
    """Require columns of one length."""
    finite(*columns.values())
    require(len({len(column) for column in columns.values()}) == 1, "lengths")


def bag(found: Bag) -> None:
    """Require messages that are written and read again as they are; strings with NUL cannot be written."""
    require(isinstance(found.topics, dict), "topics")
    for topic, time, message in found.messages():
        require(isinstance(topic, str) and time >= 0, "a topic and its time")
        try:
            data = encode(message)
        except InvalidValueError as error:
            require("NUL" in str(error), "a refusal to write")
            continue
        require(encode(decode(type(message), data)) == data, f"a message {message.type_name}")


def scene(found: Scene) -> None:
    """Require finite places."""
    for item in found.objects.values():
        finite(item.transform_object_to_world, item.color)
        rotation = item.transform_object_to_world[:3, :3]
        require(np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4), "a rotation")
    for hung in found.attached.values():
        finite(hung.transform_object_to_frame)


def mesh(found: tuple[Any, Any]) -> None:
    """Require triangles of vertices that there are."""
    vertices, faces = found
    finite(vertices)
    require(faces.shape[1] == 3 and faces.min() >= 0 and faces.max() < len(vertices), "faces")


def reach(found: ReachMap) -> None:
    """Require counts on a grid."""
    finite(found.origin, found.resolution, found.best, found.volume, found.centers)
    require((found.counts >= 0).all() and found.resolution > 0 and found.samples >= 0, "counts")


def policy(found: Policy) -> None:
    """Require actions from -1 to 1."""
    finite(found.center, found.scale, *found.weights, *found.biases)
    actions = found(np.zeros((2, found.center.size)))
    finite(actions)
    require(np.abs(actions).max(initial=0.0) <= 1.0, "actions")


def dataset_job(found: DatasetJob) -> None:
    """Require a hash, and the same job again from its text."""
    require(len(found.hash) == 64 and DatasetJob(**found.as_dict()).hash == found.hash, "hash")


def dataset(folder: Path) -> None:
    """Read all rows of a dataset."""
    found = datasets.open(folder)
    rows = found.numpy()
    require(rows["row"].tolist() == list(range(len(found))), "rows")
    finite(rows["q"])


def points(found: KeyPoints) -> None:
    """Require places that are numbers or were not seen, at times that rise."""
    finite(found.times)
    require(bool(np.all(np.diff(found.times) > 0)), "times")
    require(not np.isinf(found.points).any(), "places")
    require(found.points.shape == (len(found.times), len(found.names), 3), "shape")


def recording(folder: Path) -> None:
    """Read all of a recording."""
    found = load_recording(folder)
    require(found.timestep > 0 and math.isfinite(found.timestep), "timestep")
    run(found.run())
    for series in found.readings().values():
        require(len(series.time) == len(series.value) == len(series.truth), "readings")
    for inputs in found.inputs():
        finite(*inputs.values())
