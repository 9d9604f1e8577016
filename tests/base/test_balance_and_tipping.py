"""Balance against `pepper_kin.dynamics`, tipping against the pendulum's closed forms."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin.base import BalanceMonitor, BaseGeometry, edge_moments, simulate_tipping

G = 9.81


@pytest.fixture(scope="module")
def monitor(pepper):
    return BalanceMonitor(pepper)


def still(pepper, seconds=2.0, count=401, posture="Stand"):
    q = np.tile(pepper.posture(posture), (count, 1))
    return np.linspace(0, seconds, count), q, np.zeros_like(q), np.zeros_like(q)


def swing(pepper, size, w, seconds=1.0, count=501):
    t = np.linspace(0, seconds, count)
    q = np.tile(pepper.joint_vector({"HipPitch": -0.2, "LShoulderRoll": 0.4}), (count, 1))
    v, a = np.zeros_like(q), np.zeros_like(q)
    for name, share in (("HipPitch", 1.0), ("KneePitch", 0.4), ("HipRoll", 0.5)):
        j = pepper.joint_index(name)
        q[:, j] += share * size * np.sin(w * t)
        v[:, j], a[:, j] = share * size * w * np.cos(w * t), -share * size * w**2 * np.sin(w * t)
    return t, q, v, a


@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_the_report_agrees_with_dynamics(base):
    pepper = pk.load_pepper(base=base)
    t, q, v, a = swing(pepper, 0.1, 4.0)
    if base == "planar":
        q[:, :3], v[:, :3] = (0.7, -0.4, 2.0), (0.1, 0.2, -0.3)
    report = BalanceMonitor(pepper).assess(t, q, v, a)
    np.testing.assert_allclose(report.margin, pk.dynamics.tip_over_margin(pepper, q, v, a), atol=1e-12)
    np.testing.assert_allclose(report.wrench, pk.dynamics.base_wrench(pepper, q, v, a), atol=1e-9)
    # The three forces carry the weight and give the same moments as the floor's force at the point.
    np.testing.assert_allclose(report.wheel_forces.sum(axis=1), report.wrench[:, 2])
    center = report.wheel_forces @ BalanceMonitor(pepper).contacts / report.wrench[:, 2:3]
    np.testing.assert_allclose(center, report.point, atol=1e-12)
    assert ((report.wheel_forces.min(axis=1) < 0) == (report.margin < 0)).all()
    assert "least margin" in report.report()


def test_a_robot_at_rest_stands_on_its_center_of_mass(pepper, monitor):
    report = monitor.assess(*still(pepper))
    center = pk.dynamics.center_of_mass(pepper, pepper.posture("Stand"))
    np.testing.assert_allclose(report.point, np.tile(center[:2], (401, 1)), atol=1e-9)
    assert report.balanced
    assert report.friction.max() < 1e-9
    assert "kept throughout" in report.report()


def test_the_first_time_outside_is_named(pepper, monitor):
    t, q, v, a = swing(pepper, 0.45, 9.0)
    report = monitor.assess(t, q, v, a)
    event = report.event
    assert not report.balanced
    assert report.margin[event.index] == event.margin < 0
    assert (report.margin[: event.index] >= 0).all()
    assert event.time == t[event.index]
    assert set(event.edge) < {"WheelFL", "WheelFR", "WheelB"}
    assert "mm outside the line" in str(event)
    # The wheel that is not on that edge is the one that lifts.
    lifted = int(np.argmin(report.wheel_forces[event.index]))
    assert monitor.wheel_names[lifted] not in event.edge


def test_a_run_is_differentiated(pepper, monitor):
    t, q, v, a = swing(pepper, 0.1, 4.0, count=2001)

    class Motion:
        time, position, velocity = t, q, v

    found, exact = monitor.assess_run(Motion), monitor.assess(t, q, v, a)
    np.testing.assert_allclose(found.point[1:-1], exact.point[1:-1], atol=1e-5)
    Motion.time, Motion.position, Motion.velocity = t[:1], q[:1], v[:1]
    with pytest.raises(InvalidValueError, match="two states"):
        monitor.assess_run(Motion)


def test_a_push_moves_the_point_by_its_moment(pepper, monitor):
    t, q, v, a = still(pepper)
    mass, height, force = pk.dynamics.total_mass(pepper), 0.9, 30.0
    push = np.array([force, 0, 0, 0, height * force, 0])  # at (0, 0, height), forward
    report = monitor.assess(t, q, v, a, external=push)
    center = pk.dynamics.center_of_mass(pepper, q[0])
    assert report.point[0, 0] == pytest.approx(center[0] + force * height / (mass * G))
    assert report.friction[0] == pytest.approx(force / (mass * G))


def test_a_floor_that_would_have_to_pull(pepper, monitor):
    t, q, v, a = still(pepper, count=5)
    weight = pk.dynamics.total_mass(pepper) * G
    report = monitor.assess(t, q, v, a, external=(0, 0, 1.5 * weight, 0, 0, 0))
    assert report.event.edge == ()
    assert "have to pull" in str(report.event)
    assert np.isnan(report.point).all()
    assert (report.margin == -np.inf).all()
    assert report.wheel_forces.sum(axis=1) == pytest.approx([-0.5 * weight] * 5)


@pytest.mark.parametrize("edge", [0, 1, 2])
def test_moments_about_an_edge_agree_with_sums_over_links(pepper, monitor, edge):
    t, q, v, a = swing(pepper, 0.2, 5.0, count=7)
    found = edge_moments(monitor, monitor.assess(t, q, v, a), q, edge)
    start, end = monitor.contacts[edge], monitor.contacts[(edge + 1) % 3]
    axis = np.array([*(end - start), 0]) / np.linalg.norm(end - start)
    model, data = pepper.pinocchio_model, pepper.pinocchio_model.createData()
    import pinocchio

    h, row = 1e-5, 3
    pinocchio.forwardKinematics(model, data, q[row])
    inertia, weights, center = 0.0, 0.0, np.zeros(3)
    bodies = [(model.inertias[0], np.eye(3), np.zeros(3))]
    bodies += [
        (model.inertias[j], data.oMi[j].rotation, data.oMi[j].translation) for j in range(1, model.njoints)
    ]
    for body, turn, place in bodies:
        lever = turn @ body.lever + place - [*start, 0]
        inertia += axis @ turn @ body.inertia @ turn.T @ axis + body.mass * np.sum(np.cross(axis, lever) ** 2)
        center += body.mass * lever
        weights += body.mass
    assert found.inertia[row] == pytest.approx(inertia, rel=1e-9)
    center /= weights
    assert found.height[row] == pytest.approx(center[2])
    assert found.inside[row] == pytest.approx(np.cross(axis, center)[2], abs=1e-12)

    def angular(step):
        """Angular momentum of the level robot about the edge, outward, by Newton-Euler's quantities."""
        joints, rate = q[row] + step * v[row] + step**2 / 2 * a[row], v[row] + step * a[row]
        pinocchio.computeCentroidalMomentum(model, data, joints, rate)
        linear, turn = data.hg.linear, data.hg.angular
        return (turn + np.cross(data.com[0] - [*start, 0], linear)) @ axis

    # Positive about the axis turns the inside up, which is outward tipping; the joints' reaction opposes.
    slope = (angular(h) - angular(-h)) / (2 * h)
    assert found.drive[row] == pytest.approx(-slope, abs=1e-4)


def pendulum(pepper, monitor, edge, rate, seconds=2.0, **options):
    """Tipping of the resting robot after a blow, with the numbers of the hinged pendulum."""
    t, q, v, a = still(pepper, seconds, int(seconds * 200) + 1)
    report = monitor.assess(t, q, v, a)
    body = edge_moments(monitor, report, q, edge)
    run = simulate_tipping(monitor, report, q, start=(edge, 0.0, rate), **options)
    return run, body.inertia[0], body.inside[0], body.height[0], body.weight


@pytest.mark.parametrize("edge", [0, 1, 2])
def test_it_falls_beyond_the_critical_rate_and_comes_back_below(pepper, monitor, edge):
    _, inertia, b, h, weight = pendulum(pepper, monitor, edge, 0.0)
    assert b > 0
    critical = np.sqrt(2 * weight * (np.hypot(b, h) - h) / inertia)  # the center just over the edge
    below = pendulum(pepper, monitor, edge, 0.99 * critical, 3.0)[0]
    above = pendulum(pepper, monitor, edge, 1.01 * critical, 3.0)[0]
    assert below.status.value == "rocked"
    assert below.angle.max() < np.arctan2(b, h)
    assert "came back" in below.message
    assert above.status.value == "fallen"
    assert above.angle[-1] >= 1.2
    assert "fell over the line" in above.message


def test_energy_is_kept_while_it_tilts(pepper, monitor):
    run, inertia, b, h, weight = pendulum(pepper, monitor, 0, 0.5)
    tilted = run.angle > 0
    energy = inertia * run.rate**2 / 2 + weight * (h * np.cos(run.angle) + b * np.sin(run.angle))
    start = inertia * 0.5**2 / 2 + weight * h
    np.testing.assert_allclose(energy[tilted], start, rtol=1e-10)


def test_small_tilts_follow_the_closed_form(pepper, monitor):
    """Near the balance angle t_c: theta - t_c = (theta_0 - t_c) cosh(s t), s^2 = m g l / I."""
    t, q, v, a = still(pepper, 0.4, 401)
    report = monitor.assess(t, q, v, a)
    body = edge_moments(monitor, report, q, 0)
    b, h = body.inside[0], body.height[0]
    balance, s = np.arctan2(b, h), np.sqrt(body.weight * np.hypot(b, h) / body.inertia[0])
    run = simulate_tipping(monitor, report, q, start=(0, balance + 1e-4, 0.0))
    np.testing.assert_allclose(run.angle - balance, 1e-4 * np.cosh(s * t), rtol=1e-4)
    steady = simulate_tipping(monitor, report, q, start=(0, balance, 0.0))
    assert np.abs(steady.angle - balance).max() < 1e-9
    assert steady.status.value == "tipped"


def test_a_balanced_motion_never_tilts_and_an_unbalanced_one_does_from_the_event_on(pepper, monitor):
    t, q, v, a = swing(pepper, 0.05, 3.0)
    calm = simulate_tipping(monitor, monitor.assess(t, q, v, a), q)
    assert calm.status.value == "stood"
    assert (calm.angle == 0).all()
    t, q, v, a = swing(pepper, 0.45, 9.0)
    report = monitor.assess(t, q, v, a)
    run = simulate_tipping(monitor, report, q)
    first = int(np.argmax(run.edge >= 0))
    assert first == report.event.index
    assert monitor.edge(int(run.edge[first])) == report.event.edge
    assert run.status.value in ("rocked", "tipped", "fallen")
    assert run.angle.max() > 0


def test_a_lasting_push_beyond_the_margin_topples(pepper, monitor):
    t, q, v, a = still(pepper, 4.0, 2001)
    center = pk.dynamics.center_of_mass(pepper, q[0])
    weight = pk.dynamics.total_mass(pepper) * G
    limit = weight * (0.09 - center[0]) / 0.9  # forward at 0.9 m, over the two front wheels
    for share, status in ((0.99, "stood"), (1.05, "fallen")):
        push = share * limit * np.array([1, 0, 0, 0, 0.9, 0])
        report = monitor.assess(t, q, v, a, external=push)
        run = simulate_tipping(monitor, report, q)
        assert run.status.value == status, run.message
        assert report.balanced == (status == "stood")


def test_restitution_bounces_lower(pepper, monitor):
    dead = pendulum(pepper, monitor, 0, 0.4)[0]
    live = pendulum(pepper, monitor, 0, 0.4, restitution=0.5)[0]
    down = int(np.argmax((dead.angle[1:] == 0) & (dead.angle[:-1] > 0))) + 1
    assert (dead.angle[down:] == 0).all()
    assert live.rate[down] == pytest.approx(0.2, rel=0.02)
    assert 0 < live.angle[down:].max() < 0.5 * dead.angle.max()


def test_wheels_in_any_order_and_misuse(pepper, monitor):
    ring = np.array([[0.2, 0.2], [-0.2, -0.2], [0.2, -0.2], [-0.2, 0.2]])
    square = BaseGeometry(("a", "b", "c", "d"), ring, np.ones((4, 2)), 0.05)
    four = BalanceMonitor(pepper, square)
    report = four.assess(*still(pepper, count=3))
    assert report.wheel_forces is None
    center = pk.dynamics.center_of_mass(pepper, pepper.posture("Stand"))
    assert report.margin[0] == pytest.approx(0.2 - np.abs(center[:2]).max())
    line = BaseGeometry(("a", "b", "c"), [[0, 0], [1, 0], [2, 0]], np.ones((3, 2)), 0.05)
    with pytest.raises(InvalidValueError, match="convex polygon"):
        BalanceMonitor(pepper, line)
    t, q, v, a = still(pepper, count=3)
    with pytest.raises(InvalidValueError, match="v: got shape"):
        monitor.assess(t, q, v[:2], a)
    ours = monitor.assess(t, q, v, a)
    for arguments, words in (
        ({"restitution": 1.0}, "restitution"),
        ({"start": (5, 0.0, 0.0)}, "an edge from 0 to 2"),
        ({"start": (0, -0.1, 0.0)}, "start"),
        ({"substep": 0.0}, "substep"),
        ({"fallen_at": np.nan}, "fallen_at"),
    ):
        with pytest.raises(InvalidValueError, match=words):
            simulate_tipping(monitor, ours, q, **arguments)
    with pytest.raises(InvalidValueError, match="q: got shape"):
        simulate_tipping(monitor, ours, q[:2])


@pytest.mark.parametrize("base", ["fixed", "planar"])
@pytest.mark.parametrize("edge", [0, 1, 2])
def test_a_fall_turns_the_whole_robot_about_its_edge(base, edge):
    """By Pinocchio's exponential map, and by what a hinge keeps: two wheels on the floor, and the energy."""
    pepper = pk.load_pepper(base=base)
    monitor, rest = BalanceMonitor(pepper), still(pepper)
    if base == "planar":
        rest[1][:, :3] = 0.4, -0.2, 2.0
    run = simulate_tipping(monitor, monitor.assess(*rest), rest[1], start=(edge, 0.0, 1.5))
    assert run.status.value == "fallen"
    assert run.tilt.shape == (len(run.time), 4, 4)
    pose = pk.kinematics.frame_pose(pepper, run.position, monitor.base_frame)
    wheels = np.column_stack([monitor.contacts, np.zeros((3, 1)), np.ones((3, 1))])
    level = np.einsum("tij,kj->tki", pose, wheels)
    tilted = np.einsum("tij,tkj->tki", run.tilt, level)
    ends = [edge, (edge + 1) % 3]
    np.testing.assert_allclose(tilted[:, ends], level[:, ends], atol=1e-12)
    assert (np.diff(tilted[:, (edge + 2) % 3, 2]) > 0).all()
    way = level[0, ends[1], :3] - level[0, ends[0], :3]
    for turn, angle in zip(run.tilt[::40], run.angle[::40], strict=True):
        np.testing.assert_allclose(
            turn[:3, :3], pinocchio.exp3(angle * way / np.linalg.norm(way)), atol=1e-12
        )
    # Energy: what the center of mass has lost in height has become speed of the hinge, without losses.
    center = np.append(pk.dynamics.center_of_mass(pepper, rest[1][0]), 1.0)
    height = (run.tilt @ center)[:, 2]
    moments = edge_moments(monitor, monitor.assess(*rest), rest[1], edge)
    energy = moments.inertia[0] * run.rate**2 / 2 + moments.weight * height
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
