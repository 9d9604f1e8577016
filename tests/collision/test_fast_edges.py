import ctypes
import threading

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.collision.fast import FastChecker
from pepper_kin.collision.fast.ball_cover import ball_cover
from pepper_kin.collision.fast.certificate import leaves_range
from pepper_kin.collision.fast.motion_bounds import part_motion_bounds

SCENE = (
    pk.Scene()
    .add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    .add_cylinder("post", 0.05, 1.2, (0.35, 0.5, 0.8))
    .add_sphere("lamp", 0.1, (0.2, -0.5, 1.1))
)


def random_q(pepper, count, seed=0):
    return np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))


def states(a, b, steps):
    return a + (b - a) * (np.arange(1, steps + 1) / steps)[:, None]


def all_or_none(valid):
    return len(valid) if valid.all() else 0


def free_edges(fast, count, seed, reach):
    q = random_q(fast.pepper, 12 * count, seed)
    q = q[~fast.in_collision(q)]
    ends = q[: 2 * count].reshape(2, -1, fast.pepper.n)
    return [(a, a + reach * (b - a)) for a, b in zip(*ends, strict=True)]


def test_an_edge_is_valid_where_all_its_states_are():
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, SCENE)
    validity = fast.compiled(pepper.posture("Stand"), np.arange(pepper.n))
    memory = validity.new_memory()
    assert memory.size == validity.memory_size
    assert memory.ctypes.data % 64 == 0
    counts = []
    for k, (a, b) in enumerate(free_edges(fast, 60, seed=1, reach=0.4)):
        steps = 8 + 8 * (k % 12)
        found = validity.valid_steps(a, b, steps, memory)
        assert found == all_or_none(~fast.exact.in_collision(states(a, b, steps)))
        counts.append(found / steps)
    assert min(counts) < 0.5
    assert max(counts) == 1.0


def test_what_was_asked_before_changes_no_answer():
    """What is looked at first depends on what earlier edges met; the verdicts do not."""
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, SCENE)
    validity = fast.compiled(pepper.posture("Stand"), np.arange(pepper.n))
    used, rng = validity.new_memory(), np.random.default_rng(5)
    edges = free_edges(fast, 150, seed=3, reach=0.6)
    fresh = [validity.valid_steps(a, b, 24) for a, b in edges]
    assert 0.1 < np.mean(np.array(fresh) == 24) < 0.9
    for _ in range(5):
        for k in rng.permutation(len(edges)):
            assert validity.valid_steps(*edges[k], 24, used) == fresh[k]


def test_only_free_joints_move_and_what_rests_is_looked_at_once():
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, SCENE, margin=0.01)
    frozen = pepper.posture("Stand")
    free = np.array([pepper.joint_index(name) for name in pepper.joint_names if name.startswith("L")])
    validity = fast.compiled(frozen, free)
    ends = random_q(pepper, 80, seed=2)[:, free].reshape(2, 40, -1)
    for a, b in zip(*ends, strict=True):
        q = np.tile(frozen, (24, 1))
        q[:, free] = states(a, b, 24)
        assert validity.valid_steps(a, b, 24) == all_or_none(~fast.exact.in_collision(q))
    right = frozen.copy()
    right[pepper.joint_index("RElbowRoll")] = pepper.upper_limits[pepper.joint_index("RElbowRoll")]
    right[pepper.joint_index("RShoulderRoll")] = pepper.upper_limits[pepper.joint_index("RShoulderRoll")]
    right[pepper.joint_index("RShoulderPitch")] = 1.4
    assert fast.exact.in_collision(right)
    assert fast.compiled(right, free).valid_steps(frozen[free], frozen[free], 3) == 0
    everything = fast.compiled(right, np.arange(pepper.n))
    assert everything.valid_steps(frozen, frozen, 3) == 3


def test_effort_limits_make_a_posture_invalid():
    pepper = pk.load_pepper()
    fast = FastChecker(pepper)
    limits = 0.95 * pepper.effort_limits
    limits[pepper.joint_index("HipPitch")] *= 0.3
    validity = fast.compiled(pepper.posture("Stand"), np.arange(pepper.n), limits)
    differ = 0
    for a, b in free_edges(fast, 40, seed=3, reach=0.2):
        q = states(a, b, 24)
        held = (np.abs(pk.dynamics.gravity_torque(pepper, q)) <= limits).all(axis=-1)
        free = ~fast.exact.in_collision(q)
        assert validity.valid_steps(a, b, 24) == all_or_none(held & free)
        differ += all_or_none(held & free) != all_or_none(free)
    assert differ > 3


def test_function_at_its_address_runs_in_threads():
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, SCENE)
    validity = fast.compiled(pepper.posture("Stand"), np.arange(pepper.n))
    numbers = ctypes.POINTER(ctypes.c_double)
    kind = ctypes.CFUNCTYPE(ctypes.c_int64, numbers, numbers, ctypes.c_int64, numbers)
    function = kind(validity.address)
    edges = free_edges(fast, 40, seed=4, reach=0.3)
    expected = [validity.valid_steps(a, b, 50) for a, b in edges]
    found = [[], []]

    def work(k):
        memory = validity.new_memory()
        for a, b in edges:
            pointers = [np.ascontiguousarray(x).ctypes.data_as(numbers) for x in (a, b)]
            found[k].append(function(*pointers, 50, memory.ctypes.data_as(numbers)))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected, expected]


def test_the_last_state_is_the_end_to_the_bit():
    """Thirds of a way do not sum to 1; an end at a range's very edge must still be seen as it is."""
    pepper = pk.load_pepper()
    fast = FastChecker(pepper)
    table = next(t for t in dependent_ranges(pepper) if np.isfinite(t.upper[10]))
    a, b = pepper.posture("Stand").copy(), pepper.posture("Stand").copy()
    a[table.first] = b[table.first] = table.positions[10]
    a[table.second] = table.upper[10] - 0.37
    b[table.second] = table.upper[10]
    if fast.exact.in_collision(np.array([a, b])).any():
        pytest.skip("something else touches there")
    validity = fast.compiled(a, np.arange(pepper.n))
    assert all(validity.valid_steps(a, b, steps) == steps for steps in range(1, 40))
    b[table.second] = np.nextafter(b[table.second], np.inf)
    assert all(validity.valid_steps(a, b, steps) == 0 for steps in range(1, 40))


def test_certified_edges_are_free_at_every_sample():
    pepper = pk.load_pepper()
    fast = FastChecker(pepper, SCENE, margin=0.005)
    certified = 0
    for a, b in free_edges(fast, 150, seed=5, reach=0.3):
        found = fast.edge_certified(a, b)
        free = fast.edge_free(a, b, resolution=0.003)
        assert free or not found
        certified += found
        if not free:
            assert not found
    assert certified > 10


def test_a_short_edge_far_from_everything_is_certified():
    pepper = pk.load_pepper()
    a, b = pepper.posture("Stand").copy(), pepper.posture("Stand").copy()
    a[pepper.joint_index("LShoulderRoll")] = 0.6
    b[pepper.joint_index("LShoulderRoll")] = 1.2
    fast = FastChecker(pepper)
    assert fast.edge_free(a, b)
    assert fast.edge_certified(a, b)
    assert fast.edge_certified(a, a)


def test_a_thin_obstacle_between_samples_is_not_overlooked():
    """A wire where the hand is half way: samples at the ends see nothing, the certificate does."""
    pepper = pk.load_pepper()
    a, b = pepper.posture("Stand").copy(), pepper.posture("Stand").copy()
    a[pepper.joint_index("LShoulderRoll")] = 0.3
    b[pepper.joint_index("LShoulderRoll")] = 1.5
    hand = pk.kinematics.frame_pose(pepper, (a + b) / 2, "l_wrist")[:3, 3]
    fast = FastChecker(pepper, pk.Scene().add_cylinder("wire", 0.001, 0.3, hand))
    assert not fast.in_collision(np.array([a, b])).any()
    assert fast.edge_free(a, b, resolution=2.0)
    assert not fast.edge_certified(a, b)
    assert not fast.edge_free(a, b)


def test_ranges_along_an_edge_are_those_of_dense_samples():
    pepper = pk.load_pepper()
    rng = np.random.default_rng(6)
    for table in dependent_ranges(pepper):
        q = random_q(pepper, 400, seed=7)
        q = q[~table.violated(q)]
        left = 0
        for _ in range(150):
            a, b = q[rng.integers(len(q), size=2)]
            b = a + rng.uniform(0, 0.6) * (b - a)
            found = leaves_range(table, 0.0, a, b)
            sampled = table.violated(a + (b - a) * np.linspace(0, 1, 4001)[:, None]).any()
            assert found or not sampled
            left += found != sampled
        assert left <= 3  # a corner cut between two of 4001 samples


def test_motion_bounds_hold_for_every_sphere():
    pepper = pk.load_pepper()
    structure = FastChecker(pepper, SCENE)._prepared.structure
    motion_bounds = part_motion_bounds(pepper, structure)[len(structure.classes) :]
    model, data = pepper.pinocchio_model, pepper.pinocchio_model.createData()
    import pinocchio

    def points(q, group):
        pinocchio.forwardKinematics(model, data, q)
        return [
            data.oMi[structure.solids[i].joint].act(c)
            for i in group
            for c in ball_cover(structure.solids[i]).centers
        ]

    tightest = 0.0
    for a, b in random_q(pepper, 120, seed=8).reshape(60, 2, -1):
        b = a + 0.05 * (b - a)
        for motion_bound, group in zip(motion_bounds, structure.groups, strict=True):
            moved = np.linalg.norm(np.subtract(points(b, group), points(a, group)), axis=1).max()
            bound = motion_bound @ np.abs(b - a)
            assert moved <= bound + 1e-12
            tightest = max(tightest, moved / bound)
    assert tightest > 0.5
