"""The module `almath` of Python scripts: geometry of the plane and of space.

Functions that come in families are made by name: of a method ("distance"), of two types
("position3DFromTransform"), and in place ("transformInvertInPlace"), where the last argument gets the answer.
"""

from __future__ import annotations

import cmath
import math
import operator
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.naoqi.shims import almath_shapes, almath_types
from pepper_kin.naoqi.shims.almath_types import (
    Displacement,
    Matrix,
    Numbers,
    Pose2D,
    Position2D,
    Position3D,
    Position6D,
    Quaternion,
    Rotation,
    Rotation3D,
    Transform,
    Velocity6D,
    give,
    rotation_of_vector,
    skew,
    vectorFloat,
)

globals().update({n: v for m in (almath_shapes, almath_types) for n, v in vars(m).items() if n[0] != "_"})
PI = math.pi
PI_2, PI_4, _2_PI_, _4_PI_ = PI / 2.0, PI / 4.0, 2.0 * PI, 4.0 * PI
TO_RAD, TO_DEG = PI / 180.0, 180.0 / PI
AXIS_MASK_X, AXIS_MASK_Y, AXIS_MASK_Z = 1, 2, 4
AXIS_MASK_WX, AXIS_MASK_WY, AXIS_MASK_WZ = 8, 16, 32
AXIS_MASK_VEL, AXIS_MASK_ROT, AXIS_MASK_ALL, AXIS_MASK_NONE = 7, 56, 63, 0
AXIS_MASK_XY, AXIS_MASK_XYZ, AXIS_MASK_WYWZ, AXIS_MASK_PLANEZ = 3, 7, 48, 28


vectorPosition2D = vectorPose2D = vectorPosition6D = vectorFloat


def isAxisMask(mask: int) -> bool:
    """Return whether this is a sum of axes."""
    return 1 <= mask < 64


def modulo2PI(angle: float) -> float:
    """Return an angle within [-pi, pi] [rad]."""
    turned = math.fmod(angle, 2.0 * PI)
    return turned - math.copysign(2.0 * PI, turned) if abs(turned) > PI else turned


def weightedMeanAngle(angles: Sequence[float], weights: Sequence[float] | None = None) -> float:
    """Return the mean of angles [rad], each with its weight above 0, by default 1.

    Raises:
        RuntimeError: for another number of weights, a weight of 0 or less, or angles that have no mean.
    """
    weights = [1.0] * len(angles) if weights is None else weights
    if len(angles) != len(weights) or any(weight <= 0.0 for weight in weights):
        raise RuntimeError("weightedMeanAngle: each angle needs a weight above 0")
    total = sum(map(cmath.rect, weights, angles))
    if abs(total) < 1e-3:
        raise RuntimeError("weightedMeanAngle: the angles have no mean")
    return cmath.phase(total)


meanAngle = weightedMeanAngle


def clipData(lower: float, upper: float, data: Any) -> Any:
    """Clip a list, or one of lists, in place, and return whether that changed it; return a number clipped."""
    if not isinstance(data, list):
        return min(max(data, lower), upper)
    clipped = [clipData(lower, upper, value) for value in data]
    if data and isinstance(data[0], list):
        return any(clipped)
    changed, data[:] = clipped != data, clipped
    return changed


def modulo2PIInPlace(*_: Any) -> None:
    """Refuse, as on the robot: a number of Python cannot be changed in place."""
    raise TypeError("a number of Python cannot be changed in place")


applyRotation = modulo2PIInPlace


# Conversions


def _convert(kind: Any, source: Any) -> Any:
    """Return what a type has of another: numbers of the same names, else those of the same pose."""
    posed = (Matrix, Quaternion, Displacement)
    if issubclass(kind, posed) or isinstance(source, posed):
        return kind.of_matrix(source.to_matrix())
    found = source.in_space()
    return kind([found[name] for name in kind.names])


def quaternionFromRotation3D(rotation: Rotation3D) -> Quaternion:
    """Return the product of the quaternions about z, y and x."""
    x, y, z = rotation
    turn = Quaternion.fromAngleAndAxisRotation
    return turn(z, 0, 0, 1) * turn(y, 0, 1, 0) * turn(x, 1, 0, 0)


def angleAndAxisRotationFromQuaternion(quaternion: Quaternion) -> list[float]:
    """Return the angle [rad] and the axis of a unit quaternion; that of no turn is x."""
    w, vector = quaternion.values[0], quaternion.values[1:]
    length = float(np.linalg.norm(vector))
    axis = vector / length if length > 1e-4 else [1.0, 0.0, 0.0]
    return vectorFloat([2.0 * math.atan2(length, w), *axis])


def quaternionPosition3DFromPosition6D(
    place: Position6D, quaternion: Quaternion, position: Position3D
) -> None:
    """Write the rotation and the position of a place into two objects."""
    give(quaternion, quaternionFromRotation3D(_convert(Rotation3D, place)))
    give(position, _convert(Position3D, place))


def pose2DFromPosition2D(position: Position2D, angle: float = 0.0) -> Pose2D:
    """Return the pose at a position, turned by an angle [rad]."""
    return Pose2D([*position, angle])


def transformFromRotationPosition3D(rotation: Rotation, *position: Any) -> Transform:
    """Return the transform of a rotation and of a position, or x, y, z [m]."""
    return _moved(_convert(Transform, rotation), Position3D(*position))


def _moved(transform: Transform, position: Numbers) -> Transform:
    result = +transform
    result.values[Transform.apart] = position.values
    return result


def transformFromRotVec(*arguments: Any) -> Transform:
    """Return the transform of an axis (`AXIS_MASK_X`, ...) and an angle [rad], of a position, or of these."""
    axis, angle = arguments[:2] if len(arguments) > 1 else (AXIS_MASK_NONE, 0.0)
    vector = [angle if axis == one else 0.0 for one in (AXIS_MASK_X, AXIS_MASK_Y, AXIS_MASK_Z)]
    transform = _convert(Transform, Rotation(rotation_of_vector(vector).ravel()))
    return transform if len(arguments) == 2 else _moved(transform, arguments[-1])


def _rotation_from_axes(names: str, *axes: Position3D) -> Rotation:
    """Return the rotation with two or three columns."""
    found = dict(zip(names, axes, strict=True))
    for one, second, third in ("XYZ", "YZX", "ZXY"):
        if one not in found:
            found[one] = found[second].crossProduct(found[third])
    return Rotation(np.array([found[name].values for name in "XYZ"]).T.ravel())


def orthogonalSpace(axis: Position3D, out: Transform | None = None) -> Transform | None:
    """Return a rotation whose z is along a vector, or write it into a transform, which keeps its position."""
    x, y, z = unit = axis.normalize()
    side = (-y, x, 0.0) if abs(x) > 1e-4 else (0.0, -z, y) if abs(y) > 1e-4 else (z, 0.0, 0.0)
    first = Position3D(side).normalize()
    turn = _convert(Transform, _rotation_from_axes("XZ", first, unit))
    if out is None:
        return turn
    give(out, _moved(turn, _convert(Position3D, out)))
    return None


def axisRotationProjection(axis: Position3D, turn: Any) -> Any:
    """Return the rotation about an axis that is nearest to a rotation, of a `Rotation` or `Transform`.

    Its angle solves a cos + b sin = c; about x, y and z that is the angle of the column after the next in the
    plane. Of two it is that with the larger trace. For slanting axes the robot has a misprint.
    """
    n, matrix = axis.normalize().values, turn.to_matrix()
    r, along = matrix[:3, :3], matrix[:3, :3] @ n
    cycles = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
    c = sum(n[i] * n[k] * along[j] for i, j, k in cycles)
    a = sum(n[i] * r[j, k] for i, j, k in cycles) - c
    b = sum(n[i] * (r[k, k] * n[i] - r[k, i] * n[k]) for i, j, k in cycles)
    if a * a + b * b < c * c:
        raise RuntimeError("axisRotationProjection: no rotation about this axis is near")
    middle, apart = math.atan2(b, a), math.acos(c / math.hypot(a, b))
    turns = [rotation_of_vector(n * angle) for angle in (middle + apart, middle - apart)]
    matrix[:3, :3] = max(turns, key=lambda each: float(np.trace(each.T @ r)))
    return turn.of_matrix(matrix)


# Velocities


def _along(vector: Array) -> Array:
    """Return the way of a velocity while its rotation vector is turned by, shape (3, 3)."""
    k, angle = skew(vector), float(np.linalg.norm(vector))
    third = 1.0 / 6.0 if angle < 1e-3 else (angle - math.sin(angle)) / angle**3
    return np.eye(3) + 0.5 * np.sinc(angle / (2.0 * PI)) ** 2 * k + third * k @ k


def velocityExponential(velocity: Velocity6D) -> Transform:
    """Return where a velocity leads within 1 s."""
    linear, angular = velocity.values[:3], velocity.values[3:]
    turn = Rotation(rotation_of_vector(angular).ravel())
    return transformFromRotationPosition3D(turn, _along(angular) @ linear)


def transformLogarithm(transform: Transform) -> Velocity6D:
    """Return the velocity that leads to a transform within 1 s."""
    quaternion = _convert(Quaternion, transform)
    sine = float(np.linalg.norm(quaternion.values[1:]))
    angular = quaternion.values[1:] * (2.0 * math.atan2(sine, quaternion.values[0]) / sine if sine else 2.0)
    return Velocity6D([*np.linalg.solve(_along(angular), transform.values[Transform.apart]), *angular])


def transformMean(first: Transform, second: Transform, share: float = 0.5) -> Transform:
    """Return the transform after a share of the way from one to another, at a constant velocity."""
    if not 0.0 <= share <= 1.0:
        raise RuntimeError(f"transformMean: a share of {share:g}; it is from 0 to 1")
    return first * velocityExponential(transformLogarithm(first.diff(second)) * share)


def position6DFromTransformDiff(current: Transform, target: Transform) -> Position6D:
    """Return the way from one transform to another [m], and half the sum of the products of their axes."""
    a, b = current.to_matrix(), target.to_matrix()
    return Position6D([*(b - a)[:3, 3], *0.5 * np.cross(a[:3, :3], b[:3, :3], axis=0).sum(axis=1)])


def pointMassRotationalInertia(mass: float, position: Position3D, out: list[float]) -> None:
    """Write the 9 numbers of the inertia of a point [kg m²] into a list."""
    k = skew(position)
    out[:] = (-mass * k @ k).ravel().tolist()


def changeReferencePose2D(angle: float, pose: Pose2D) -> Pose2D:
    """Return a pose with its position turned by an angle [rad]."""
    x, y, theta = pose
    return Pose2D([*(Pose2D(0.0, 0.0, angle) * Position2D(x, y)), theta])


def _turned(transform: Transform, of: Any) -> Any:
    """Return vectors, or another transform, turned by the rotation of a transform."""
    turn = transform.to_matrix()[:3, :3]
    columns = of.values.reshape(3, -1) if isinstance(of, Matrix) else of.values.reshape(-1, 3).T
    turned = turn @ columns
    return of.of((turned if isinstance(of, Matrix) else turned.T).ravel())


def _turned_back(transform: Transform, of: Any) -> Any:
    """Return vectors, or another transform, turned by the inverse of the rotation of a transform."""
    return _turned(transform.inverse(), of)


# Feet, as boxes of corners that go round clockwise


def intersectionSegment2D(a1: Any, a2: Any, b1: Any, b2: Any, out: Any) -> bool:
    """Return whether two segments that are not parallel meet; write where."""
    a, b, between = a2 - a1, b2 - b1, b1 - a1
    across = a.crossProduct(b)
    if abs(across) < 1e-5:
        return False
    share, other = between.crossProduct(b) / across, between.crossProduct(a) / across
    if not (0.0 <= share <= 1.0 and 0.0 <= other <= 1.0):
        return False
    give(out, a1 + a * share)
    return True


def areTwoBoxesInCollision(first: list[Any], second: list[Any]) -> bool:
    """Return whether sides of two boxes meet, or one holds the other's first corner."""
    sides = [list(zip(box, [*box[1:], *box[:1]], strict=True)) for box in (first, second)]
    if any(intersectionSegment2D(*a, *b, Position2D()) for a in sides[0] for b in sides[1]):
        return True
    return any(
        bool(other) and all((end - begin).crossProduct(other[0] - begin) < 0.0 for begin, end in box)
        for box, other in zip(sides, (second, first), strict=True)
    )


def computeBox(box: list[Any], pose: Pose2D, out: list[Any]) -> None:
    """Write the corners of a box that is moved."""
    out[:] = [pose * corner for corner in box]


def dichotomie(fixed: list[Any], moving: list[Any], move: Pose2D) -> None:
    """Reduce the angle of a move to the largest without a collision, of 32 between 0 and it."""
    low, high = 0.0, move.values[2]
    for _ in range(5):
        move.values[2] = (low + high) / 2.0
        if areTwoBoxesInCollision(fixed, [move * corner for corner in moving]):
            high = move.values[2]
        else:
            low = move.values[2]
    move.values[2] = low


def avoidFootCollision(left: list[Any], right: list[Any], leftIsSupport: bool, move: Pose2D) -> bool:
    """Reduce the angle of a move of the other foot; return whether the feet would collide."""
    fixed, moving = (left, right) if leftIsSupport else (right, left)
    collide = areTwoBoxesInCollision(fixed, [move * corner for corner in moving])
    if collide:
        dichotomie(fixed, moving, move)
    return collide


def clipFootWithEllipse(maxX: float, maxY: float, move: Pose2D) -> bool:
    """Shorten a move to an ellipse; return whether it was longer."""
    length = math.hypot(move.values[0] / maxX, move.values[1] / maxY)
    if length * length >= 1.00001:
        move.values[:2] /= length
    return length * length >= 1.00001


def getDubinsSolutions(target: Pose2D, circleRadius: float) -> list[Pose2D]:
    """Return where a way of arc, straight line and arc changes, and the target: that of the shortest line.

    Args:
        target: Where to arrive, as seen from the start; at least 4 radii away.
        circleRadius: Of the arcs [m].
    """
    if target.norm() < 4.0 * circleRadius:
        raise RuntimeError(f"getDubinsSolutions: {target} is nearer than 4 times the radius {circleRadius:g}")
    x, y, theta = target
    ways = []
    for first in (1, -1):
        for last in (1, -1):
            begin = circleRadius * first * 1j
            way = complex(x, y) + circleRadius * last * 1j * cmath.rect(1.0, theta) - begin
            cosine = 0.0 if first == last else 2.0 * circleRadius / abs(way)
            normal = cmath.rect(circleRadius, cmath.phase(way) - first * math.acos(cosine))
            ways.append((begin + normal, begin + way + first * last * normal, first, last))
    start, end, first, last = min(ways, key=lambda each: abs(each[1] - each[0]))
    heading = cmath.phase(end - start)
    leaving = 2.0 * PI + heading if first * heading < 0.0 else heading
    turn = theta - heading
    arriving = 2.0 * PI + heading if last * turn < 0.0 else heading
    places = [(start.real, start.imag, leaving), (end.real, end.imag, arriving)]
    return vectorPose2D([*(Pose2D(place) for place in places), target])


# The families


def _add(name: str, function: Callable[..., Any], operands: int) -> None:
    """Add a function; a further argument, after the operands, gets its answer."""

    def call(*arguments: Any) -> Any:
        result = function(*arguments[:operands])
        return result if len(arguments) <= operands else give(arguments[operands], result)

    call.__name__, call.__doc__ = name, function.__doc__
    globals()[name] = call


def _add_in_place(name: str, function: Callable[..., Any]) -> None:
    """Add a function whose last operand gets its answer."""
    globals()[name] = lambda *operands: give(operands[-1], function(*operands))


def _call_method(name: str, of: Any, *arguments: Any) -> Any:
    return getattr(of, name)(*arguments)


def _determinant(of: Any) -> float:
    """Return the determinant of the rotation of an object, or of a list of 12 or 16 numbers."""
    matrix = of.to_matrix() if isinstance(of, Matrix) else np.reshape(of[:12], (3, 4))
    return float(np.linalg.det(matrix[:3, :3]))


_CONVERSIONS = """
transformFrom Position3D Position6D Pose2D* Rotation3D Rotation Quaternion Displacement
position6DFrom Transform* Pose2D* Position3D* Velocity6D
position3DFrom Transform* Position6D
position2DFrom Transform* Pose2D*
pose2DFrom Transform* Position6D*
rotation3DFrom Transform Rotation Quaternion
rotationFrom Transform* Quaternion
quaternionFrom Transform
displacementFrom Transform
"""  # of those with a star there is a form in place
_METHODS = {
    1: "norm normalize transpose determinant pinv=inverse transformInverse=inverse pose2DInverse=inverse "
    "quaternionInverse=inverse normalizeTransform normalizeRotation",
    2: "distance distanceSquared dotProduct crossProduct transformDiff=diff pose2dDiff=diff "
    "transformDistance=distance transformDistanceSquared=distanceSquared",
    9: "isUnitVector isOrthogonal",
}  # by the number of their operands
_FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "determinant": (_determinant, 1),
    "transformToFloatVector": (lambda transform: vectorFloat(transform.toVector()[:12]), 1),
    "quaternionFromRotation3D": (quaternionFromRotation3D, 1),
    "changeReferencePose2D": (changeReferencePose2D, 2),
    "pose2DFromPosition2DInPlace": (pose2DFromPosition2D, 2),
    "position6DFromTransformDiffInPlace": (position6DFromTransformDiff, 2),
    "transformLogarithmInPlace": (transformLogarithm, 1),
    "velocityExponentialInPlace": (velocityExponential, 1),
    "transformMeanInPlace": (transformMean, 3),
}
_IN_PLACE: dict[str, Callable[..., Any]] = {
    "transformFromPosition3D": lambda position, old: _moved(old, position),
    "transformFromRotation": lambda turn, old: _moved(_convert(Transform, turn), _convert(Position3D, old)),
    "transformFromRotVec": lambda *arguments: transformFromRotVec(*arguments[:-1]),
    "changeReferencePose2D": changeReferencePose2D,
    "changeReferencePosition3D": _turned,
    "changeReferenceTransposePosition3D": _turned_back,
    "axisRotationProjection": axisRotationProjection,
    "transformInvert": Transform.inverse,
    "pose2dInvert": Pose2D.inverse,
}

for _line in _CONVERSIONS.strip().splitlines():
    _target, *_sources = _line.split()
    _kind = vars(almath_types)[_target[0].upper() + _target[1:-4]]
    for _source in _sources:
        _add(_target + _source.strip("*"), partial(_convert, _kind), 1)
        if "*" in _source:
            _add(_target + _source.replace("*", "InPlace"), partial(_convert, _kind), 1)
for _operands, _names in _METHODS.items():
    for _name, _, _method in (each.partition("=") for each in _names.split()):
        _add(_name, partial(_call_method, _method or _name), _operands)
for _name in ("Position3D", "Position6D", "Velocity6D", "Transform"):
    _add(f"changeReference{_name}", _turned, 2)
    _add(f"changeReferenceTranspose{_name}", _turned_back, 2)
for _name, (_function, _operands) in _FUNCTIONS.items():
    _add(_name, _function, _operands)
for _name, _function in _IN_PLACE.items():
    _add_in_place(f"{_name}InPlace", _function)
_add_in_place("transformPreMultiply", operator.mul)
for _axes in ("XY", "XZ", "YZ", "XYZ"):
    globals()[f"rotationFromAxes{_axes}"] = partial(_rotation_from_axes, _axes)
_of_quaternion = globals()["rotationFromQuaternion"]
for _kind in (Position2D, Pose2D, Quaternion, Rotation, Transform, almath_shapes.OccupancyMapParams):
    for _name in dir(_kind):
        if _name.startswith(("from", "getPixelFromOffset")):  # the flat names of what belongs to a type
            globals()[f"{_kind.__name__}_{_name}"] = getattr(_kind, _name)
            if issubclass(_kind, Matrix | Quaternion):
                globals()[f"{_kind.__name__.lower()}F{_name[1:]}"] = getattr(_kind, _name)
globals()["rotationFromQuaternion"] = lambda *q: (_of_quaternion if len(q) < 4 else Rotation.fromQuaternion)(
    *q
)
