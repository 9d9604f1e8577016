"""What machine code knows of near bodies in a tick, against coal, and what is raised meanwhile."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.checker import checker_for
from pepper_kin.collision.near_pairs import measure_by_coal, pairs_within
from pepper_kin.core.brake_check import FARTHEST
from pepper_kin.core.near_state import come_nearer, near_at
from pepper_kin.servo import clearance_guard
from pepper_kin.servo.clearance_guard import ClearanceGuard

CORNERS = np.random.default_rng(1).normal(size=(40, 3))
CORNERS *= 0.1 / np.linalg.norm(CORNERS, axis=1)[:, None]
POINTS = np.random.default_rng(2).uniform((0.2, -0.5, 0.7), (0.8, 0.5, 0.72), (500, 3))
SCENE = (
    pk.Scene()
    .add_convex_mesh("hull", CORNERS, position=(0.35, 0.1, 0.95))
    .add_point_cloud("cloud", POINTS, radius=0.01)
    .add_box("box", (0.2, 0.2, 0.2), (0.3, -0.4, 0.9))
)


@pytest.mark.parametrize("kind", [{}, {"base": "planar", "hands": "mimic"}])
def test_near_pairs_and_those_that_come_nearer_are_coals(kind, monkeypatch):
    pepper, rng, met = pk.load_pepper(**kind), np.random.default_rng(3), np.zeros(2, int)
    guard, checker = ClearanceGuard(pepper, SCENE, 0.005, 4.0), checker_for(pepper, SCENE)
    world = guard.world
    lower, upper = np.maximum(pepper.lower_limits, -0.3), np.minimum(pepper.upper_limits, 0.5)
    q = lower
    asked, measure = ([], []), clearance_guard.measure_by_coal
    for k in range(24):
        again = k % 4 > 0  # in small steps, coal is asked again only about what may be near
        q = q + 0.001 * rng.normal(size=pepper.n) if again else rng.uniform(lower, upper)
        sizes = asked[again]
        monkeypatch.setattr(
            clearance_guard,
            "measure_by_coal",
            lambda *a, n=sizes: n.append(a[2].size * (len(a[1]) == 1)) or measure(*a),
        )
        found, expected = near_at(world, q, FARTHEST), pairs_within(checker, q, FARTHEST)
        np.testing.assert_array_equal(found.indices, expected.indices)
        # Coal's answers depend a little on what it was asked before.
        np.testing.assert_allclose(found.distances, expected.distances, atol=1e-5)
        np.testing.assert_allclose(found.table.gradients, expected.gradients, atol=1e-2)
        shifts = np.linspace(0.0, 1.0, 6)[1:, None] * 0.1 * rng.normal(size=pepper.n)
        states = pepper.to_full(q + shifts)
        distances = measure_by_coal(checker, states, found.indices, 0.0)[..., 0].min(axis=0)
        least = rng.uniform(-0.02, 0.05, found.indices.size)
        nearer = np.empty(found.indices.size, dtype=bool)
        assert come_nearer(world, q, shifts, found.indices, least, nearer)
        clear = np.abs(distances - least) > 2e-5  # coal's accuracy
        np.testing.assert_array_equal(nearer[clear], (distances < least)[clear])
        met += [np.count_nonzero(nearer), np.count_nonzero(~nearer)]
    assert met.min() > 50
    assert np.sum(asked[True]) / 3 < 0.8 * np.sum(asked[False])


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_what_is_raised_while_machine_code_runs_is_raised_by_the_tick(error, monkeypatch):
    pepper = pk.load_pepper()
    servo = pk.servo.Servo(pepper, pepper.joint_vector({"LShoulderPitch": 0.9}), scene=SCENE)
    before, calls = servo.q, []

    def raising(*_):
        calls.append(1)
        raise error("told")

    servo.set_target(pk.ik.HandPosition("left", (0.45, 0.15, 0.9)))
    with monkeypatch.context() as patch:
        patch.setattr(clearance_guard, "measure_by_coal", raising)
        with pytest.raises(error, match="told"):
            servo.step()
    assert calls == [1]
    assert servo.q is before
    assert servo.step().tick == 1
