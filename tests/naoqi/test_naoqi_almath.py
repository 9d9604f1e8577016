"""`almath` beside Pinocchio, SciPy and the laws of groups."""

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation as Turn

from pepper_kin.naoqi.shims import almath

RNG = np.random.default_rng(0)
NUMBERS = [
    almath.Position2D, almath.Position3D, almath.Rotation3D, almath.Position6D, almath.Velocity3D,
    almath.Velocity6D, almath.PositionAndVelocity, almath.Pose2D, almath.Quaternion,
]  # fmt: skip


def turn():
    return Turn.random(random_state=RNG)


def transform():
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn().as_matrix(), RNG.uniform(-2, 2, 3)
    return almath.Transform(matrix.ravel()), pin.SE3(matrix)


def matrix_of(found):
    numbers = np.array(found.toVector())
    return numbers.reshape(3, 3) if numbers.size == 9 else numbers.reshape(4, 4)


@pytest.mark.parametrize("kind", NUMBERS, ids=lambda kind: kind.__name__)
def test_numbers_add_up_scale_and_are_known_by_name(kind):
    a, b = (RNG.uniform(-2, 2, len(kind.names)) for _ in range(2))
    one, two = kind(*a), kind(list(b))
    for found, expected in [
        (one + two, a + b),
        (one - two, a - b),
        (2.0 * one, 2 * a),
        (one / 2.0, a / 2),
        (-one, -a),
    ]:
        assert type(found) is kind
        assert list(found) == pytest.approx(list(expected))
    assert [getattr(one, name) for name in kind.names] == list(a)
    alias, out = one, almath.vectorFloat()
    one += two
    assert list(alias) == pytest.approx(list(a + b))
    setattr(one, kind.names[0], 0.25)
    one.toVector(out)
    assert out == list(alias)
    assert alias.toVector()[0] == 0.25
    assert one == alias
    assert one.isNear(alias + kind([1e-5] * a.size))
    assert not one.isNear(alias + kind([1e-3] * a.size))
    with pytest.raises(RuntimeError, match="division by zero"):
        one / 0.0
    with pytest.raises(TypeError, match=rf"{kind.__name__} of 9 numbers; it has {a.size}"):
        kind(*range(9))


def test_lists_of_a_wrong_size_leave_the_default(capsys):
    assert almath.Pose2D([1.0, 2.0]) == almath.Pose2D()
    assert almath.Transform([1.0] * 9) == almath.Transform()
    assert "WARNING: Pose2D of 2 numbers" in capsys.readouterr().err


def test_norms_and_distances():
    a, b = RNG.uniform(-2, 2, (2, 6))
    assert almath.norm(almath.Position6D(*a)) == pytest.approx(np.linalg.norm(a))
    assert almath.distance(almath.Position6D(*a), almath.Position6D(*b)) == pytest.approx(
        np.linalg.norm((a - b)[:3])
    )
    pose = almath.Pose2D(3.0, 4.0, 0.3)
    assert list(pose.normalize()) == pytest.approx([0.6, 0.8, 0.3])
    assert pose.distanceSquared(almath.Pose2D()) == pytest.approx(25.0)
    with pytest.raises(RuntimeError, match="normalize of a length of 0"):
        almath.Position3D().normalize()
    x, y = almath.Position3D(*a[:3]), almath.Position3D(*b[:3])
    assert list(almath.crossProduct(x, y)) == pytest.approx(list(np.cross(a[:3], b[:3])))
    assert x.isOrthogonal(x.crossProduct(y))
    assert almath.crossProduct(almath.Position2D(1, 0), almath.Position2D(0, 2)) == 2.0


def test_transforms_are_a_group():
    for _ in range(50):
        (a, se3_a), (b, se3_b) = transform(), transform()
        assert matrix_of(a * b) == pytest.approx((se3_a * se3_b).homogeneous)
        assert matrix_of(almath.transformDiff(a, b)) == pytest.approx(se3_a.actInv(se3_b).homogeneous)
        assert (a * almath.pinv(a)).isNear(almath.Transform(), 1e-9)
        point = RNG.uniform(-1, 1, 3)
        assert list(a * almath.Position3D(*point)) == pytest.approx(list(se3_a.act(point)))
        assert a.determinant() == almath.determinant(a.toVector()) == pytest.approx(1.0)
        assert a.isTransform()
        left = almath.Transform(b.toVector())
        almath.transformPreMultiply(a, left)
        assert left.isNear(a * b, 1e-12)
        almath.transformInvertInPlace(left)
        assert left.isNear(b.inverse() * a.inverse(), 1e-9)
        skewed = almath.Transform(a.toVector()[:12])
        skewed.r1_c1 += 0.01
        skewed.normalizeTransform()
        assert skewed.isTransform(1e-9)
        assert skewed.r3_c3 == pytest.approx(a.r3_c3)


def test_logarithms_and_exponentials_are_those_of_pinocchio():
    for size in (0.0, 1e-6, 1e-3, 0.5, 2.9):
        velocity = np.concatenate(
            [RNG.uniform(-1, 1, 3), size * Turn.random(random_state=RNG).apply([1.0, 0, 0])]
        )
        found = almath.velocityExponential(almath.Velocity6D(*velocity))
        assert matrix_of(found) == pytest.approx(pin.exp6(velocity).homogeneous, abs=1e-9)
        assert list(almath.transformLogarithm(found)) == pytest.approx(list(velocity), abs=1e-6)
    (a, se3_a), (b, se3_b) = transform(), transform()
    expected = se3_a * pin.exp6(0.3 * pin.log6(se3_a.actInv(se3_b)).vector)
    assert matrix_of(almath.transformMean(a, b, 0.3)) == pytest.approx(expected.homogeneous)
    with pytest.raises(RuntimeError, match="a share of 2"):
        almath.transformMean(a, b, 2.0)


def test_rotations_are_those_of_scipy():
    for _ in range(50):
        expected = turn()
        x, y, z, w = expected.as_quat()
        quaternion, other = almath.Quaternion(w, x, y, z), almath.Quaternion(*np.roll(turn().as_quat(), 1))
        rotation = almath.rotationFromQuaternion(quaternion)
        assert matrix_of(rotation) == pytest.approx(expected.as_matrix())
        assert almath.rotationFromQuaternion(w, x, y, z) == rotation
        assert almath.quaternionFromTransform(almath.transformFromRotation(rotation)).isNear(quaternion, 1e-9)
        angles = almath.rotation3DFromRotation(rotation)
        assert list(angles) == pytest.approx(list(expected.as_euler("ZYX")[::-1]))
        assert almath.quaternionFromRotation3D(angles).isNear(quaternion, 1e-9)
        angle, *axis = almath.angleAndAxisRotationFromQuaternion(quaternion)
        assert Turn.from_rotvec(np.multiply(angle, axis)).as_matrix() == pytest.approx(expected.as_matrix())
        assert almath.rotationFromAngleDirection(angle, almath.Position3D(*axis)).isNear(rotation, 1e-9)
        assert almath.transformFromQuaternion(quaternion * other).isNear(
            almath.transformFromQuaternion(quaternion) * almath.transformFromQuaternion(other), 1e-9
        )
        assert (quaternion * quaternion.inverse()).isNear(almath.Quaternion(), 1e-9)
        columns = [almath.Position3D(*column) for column in expected.as_matrix().T]
        for names in ("XY", "XZ", "YZ", "XYZ"):
            made = getattr(almath, f"rotationFromAxes{names}")(
                *(columns["XYZ".index(name)] for name in names)
            )
            assert made.isNear(rotation, 1e-9)
    with pytest.raises(RuntimeError, match="length of 2, not 1"):
        almath.rotationFromAngleDirection(0.3, 0.0, 0.0, 2.0)


def test_conversions_come_back_and_answer_in_place():
    for _ in range(20):
        start, _ = transform()
        for name in ("Position6D", "Displacement"):
            there = getattr(almath, f"{name[0].lower()}{name[1:]}FromTransform")(start)
            assert getattr(almath, f"transformFrom{name}")(there).isNear(start, 1e-9)
        pose, out = almath.Pose2D(*RNG.uniform(-1, 1, 2), 3.5), almath.Pose2D()
        assert almath.pose2DFromPosition6D(almath.position6DFromPose2D(pose)) == pose
        almath.pose2DFromTransformInPlace(almath.transformFromPose2D(pose), out)
        assert list(out) == pytest.approx([*list(pose)[:2], 3.5 - 2 * math.pi])
        assert (pose * pose.inverse()).isNear(almath.Pose2D(), 1e-9)
        place, turned = almath.Position3D(*RNG.uniform(-1, 1, 3)), almath.Position3D()
        almath.changeReferencePosition3D(start, place, turned)
        assert list(turned) == pytest.approx(list(matrix_of(start)[:3, :3] @ list(place)))
        almath.changeReferenceTransposePosition3DInPlace(start, turned)
        assert turned.isNear(place, 1e-9)
        frame = almath.orthogonalSpace(place)
        assert frame.isTransform(1e-9)
        assert list(
            almath.position3DFromTransform(frame * almath.Transform(0, 0, place.norm()))
        ) == pytest.approx(list(place))
    with pytest.raises(TypeError, match="cannot become"):
        almath.pose2DFromTransformInPlace(start, almath.Position2D())


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_about_an_axis_is_its_own_projection(axis):
    numbers = np.zeros(3)
    numbers[axis] = 0.7
    about = almath.transformFrom3DRotation(*numbers)
    assert almath.axisRotationProjection(almath.Position3D(*numbers), about).isNear(about, 1e-9)
    assert almath.transformFromRotVec(1 << axis, 0.7).isNear(about, 1e-12)


def test_angles():
    assert almath.modulo2PI(7.0) == pytest.approx(7.0 - 2 * math.pi)
    assert almath.modulo2PI(-math.pi) == -math.pi
    assert abs(almath.meanAngle([3.1, -3.1])) == pytest.approx(math.pi)
    assert almath.weightedMeanAngle([0.0, 1.0], [1.0, 1e9]) == pytest.approx(1.0)
    with pytest.raises(RuntimeError, match="no mean"):
        almath.meanAngle([0.0, math.pi])
    data = almath.vectorFloat([-2.0, 0.5, 2.0])
    assert almath.clipData(-1.0, 1.0, data)
    assert data == [-1.0, 0.5, 1.0]
    assert not almath.clipData(-1.0, 1.0, data)
    with pytest.raises(TypeError, match="cannot be changed in place"):
        almath.modulo2PIInPlace(7.0)


def test_dubins_ways_touch_their_circles_and_arrive():
    for _ in range(200):
        goal = almath.Pose2D(*RNG.uniform(-3, 3, 2), RNG.uniform(-3, 3))
        if goal.norm() < 1.2:
            with pytest.raises(RuntimeError, match="nearer than 4 times"):
                almath.getDubinsSolutions(goal, 0.3)
            continue
        start, end, last = almath.getDubinsSolutions(goal, 0.3)
        assert last == goal
        assert min(abs(math.hypot(start.x, start.y - side) - 0.3) for side in (0.3, -0.3)) < 1e-9
        seen = goal.diff(end)
        assert min(abs(math.hypot(seen.x, seen.y - side) - 0.3) for side in (0.3, -0.3)) < 1e-9
        line = almath.Pose2D(start.x, start.y, start.theta).diff(end)
        assert abs(line.y) < 1e-9
        assert line.x > 0.0


def test_feet_turn_only_as_far_as_they_do_not_meet():
    foot = almath.vectorPosition2D(
        almath.Position2D(x, y) for x, y in ((-0.1, -0.04), (-0.1, 0.04), (0.1, 0.04), (0.1, -0.04))
    )
    free, inward = almath.Pose2D(0.0, 0.3, 0.1), almath.Pose2D(0.0, 0.1, 0.9)
    assert not almath.avoidFootCollision(foot, foot, True, free)
    assert free.theta == 0.1
    assert almath.avoidFootCollision(foot, foot, True, inward)
    assert 0.0 < inward.theta < 0.9
    moved = almath.vectorPosition2D()
    almath.computeBox(foot, inward, moved)
    assert not almath.areTwoBoxesInCollision(foot, moved)
    assert almath.areTwoBoxesInCollision(foot, [corner * 0.1 for corner in foot])
    step = almath.Pose2D(0.3, 0.4, 0.2)
    assert almath.clipFootWithEllipse(0.1, 0.1, step)
    assert list(step) == pytest.approx([0.06, 0.08, 0.2])


def test_maps_and_shapes():
    cells = almath.OccupancyMapParams(100, 0.05, almath.Position2D(1.0, 2.0))
    assert cells.getPixelFromPosition(almath.Position2D(1.0, 2.0)) == almath.Point2Di(50, 50)
    for _ in range(20):
        place = almath.Position2D(*RNG.uniform(-1, 3, 2))
        assert cells.getPositionFromPixel(cells.getPixelFromPosition(place)).distance(place) < 0.036
    pose = cells.getPoseFromPixel(almath.Pose2Di(almath.Point2Di(0, 0), 0.5))
    assert list(pose) == pytest.approx([-1.5, 4.5, 0.5])
    assert almath.Pill(0.2, 0.1).getRadius() == 0.1
    with pytest.raises(RuntimeError, match="no pills"):
        almath.Pill(0.2, 0.1).accept(almath.NotImplementedShape3DVisitor("no pills"))
