"""Batches of twins in worlds of their own: each row does what a single twin in its world does."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import Scene
from pepper_kin.dynamics import external_torque
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.kinematics import frame_pose
from pepper_kin.twin import Twin, TwinBatch, actuator_parameters
from pepper_kin.twin.world import World

N, STEPS = 10, 25
H = 0.001


def world_of(pepper, **options):
    """A parcel on a table before the robot, a ball that rolls, and an obstacle that comes."""
    scene = Scene().add_box("table", (0.5, 0.8, 0.05), (0.55, 0.0, 0.7))
    scene = scene.add_sphere("comer", 0.05, (0.25, 0.4, 0.8), velocity=(0.0, -0.8, 0.0))
    world = World(pepper, scene, **options)
    world.add_box("parcel", (0.1, 0.1, 0.15), 0.4, (0.5, 0.15, 0.8))
    world.add_ball("ball", 0.04, 0.1, (0.45, -0.2, 0.77), velocity=(0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
    return world


def targets_of(pepper, count, seed=3):
    """Targets of arms that sweep over the table."""
    rng = np.random.default_rng(seed)
    low, high = pepper.lower_limits, pepper.upper_limits
    forward = pepper.neutral()
    forward[[pepper.joint_index(name) for name in ("LShoulderPitch", "RShoulderPitch")]] = 0.6
    return np.clip(forward + rng.uniform(-0.6, 0.6, (count, N, pepper.n)), low, high)


def single_run(pepper, twin, targets, outer=None):
    """Send one twin to linear commands: positions and velocities as the batch has them."""
    before = twin.state.position
    for target in targets:
        for k in range(STEPS):
            share = (k + 1) / STEPS
            twin.step(before + share * (target - before), (target - before) / (STEPS * H), load=outer)
        before = target
    return twin.state


@pytest.fixture(scope="module")
def runs(pepper):
    """A batch of twins in worlds that differ in mass and place, and the single twins beside it."""
    masses = np.linspace(0.2, 1.0, N)
    batch = TwinBatch(pepper, N, world=world_of(pepper), vary_bodies={"parcel": {"mass": masses}})
    batch.place("parcel", np.array([0.5, 0.1, 0.8]) + np.outer(np.arange(N), [0.0, 0.01, 0.0]))
    targets = targets_of(pepper, 12)
    wrenches = []
    for target in targets:
        assert batch.step(target, STEPS, commands="linear").all(), batch.failures
        wrenches.append(batch.contact_wrench)
    singles = []
    for row in range(N):
        world = World(pepper, world_of(pepper).scene)
        world.add_box("parcel", (0.1, 0.1, 0.15), masses[row], (0.5, 0.1 + 0.01 * row, 0.8))
        world.add_ball("ball", 0.04, 0.1, (0.45, -0.2, 0.77), velocity=(0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
        twin = Twin(pepper, world=world)
        singles.append((single_run(pepper, twin, targets[:, row]), world))
    return batch, singles, np.array(wrenches)


@pytest.mark.thorough
def test_rows_are_equal_to_single_twins_in_their_worlds(runs):
    batch, singles, wrenches = runs
    touched = np.abs(wrenches[..., :3]).max(axis=(0, 2)) > 1.0
    assert touched.sum() >= 3
    near = 1e-5  # impacts make rounding errors grow
    for row, (state, world) in enumerate(singles):
        np.testing.assert_allclose(batch.position[row], state.position, atol=near)
        np.testing.assert_allclose(batch.velocity[row], state.velocity, atol=100 * near)
        for name, body in world.bodies.items():
            mine = batch.body(name)
            np.testing.assert_allclose(mine.position[row], body.position, atol=near)
            np.testing.assert_allclose(mine.rotation[row], body.pose[:3, :3], atol=10 * near)
            np.testing.assert_allclose(mine.velocity[row], body.velocity, atol=1000 * near)
    moved = batch.body("comer").position[:, 1]
    np.testing.assert_allclose(moved, 0.4 - 0.8 * 12 * STEPS * H, atol=1e-9)


@pytest.mark.thorough
def test_threads_and_the_number_of_rows_change_nothing(pepper):
    targets = targets_of(pepper, 4)
    many, few = (TwinBatch(pepper, count, world=world_of(pepper)) for count in (N, 3))
    threaded = TwinBatch(pepper, 1100, world=world_of(pepper))
    for target in targets:
        many.step(target, STEPS)
        few.step(target[:3], STEPS)
        threaded.step(np.resize(target, (1100, pepper.n)), STEPS, threads=2)
    np.testing.assert_array_equal(many.position[:3], few.position)
    np.testing.assert_array_equal(many.body("parcel").position[:3], few.body("parcel").position)
    for twins in (threaded.position, threaded.body("ball").position):
        np.testing.assert_array_equal(twins[-N:], np.roll(twins[:N], N - 1100 % N, axis=0))
    np.testing.assert_array_equal(threaded.position[:N], many.position)


def test_rows_that_are_reset_begin_anew_and_others_go_on(pepper):
    batch, whole = (TwinBatch(pepper, 4, world=world_of(pepper)) for _ in range(2))
    targets = targets_of(pepper, 2)[:, :4]
    for twins in (batch, whole):
        twins.step(targets[0], STEPS)
    batch.reset(rows=[2])
    fresh = TwinBatch(pepper, 4, world=world_of(pepper))
    np.testing.assert_array_equal(batch.body("ball").position[2], fresh.body("ball").position[2])
    for twins in (batch, whole, fresh):
        twins.step(targets[1], STEPS)
    np.testing.assert_array_equal(batch.position[[0, 1, 3]], whole.position[[0, 1, 3]])
    np.testing.assert_array_equal(batch.position[2], fresh.position[2])
    np.testing.assert_array_equal(batch.body("parcel").velocity[2], fresh.body("parcel").velocity[2])


def test_a_world_that_cannot_be_solved_stops_its_row_alone(pepper):
    batch = TwinBatch(pepper, 4, world=world_of(pepper))
    batch.place("ball", velocity=(1e7, 0.0, 0.0, 0.0, 0.0, 0.0), rows=[1])
    before = batch.position
    sound = batch.step(pepper.neutral() + 0.1, STEPS)
    np.testing.assert_array_equal(sound, [True, False, True, True])
    assert list(batch.failures) == [1]
    assert "faster" in batch.failures[1]
    np.testing.assert_array_equal(batch.position[1], before[1])
    batch.reset(rows=[1])
    assert not batch.failures
    assert batch.step(pepper.neutral() + 0.1, STEPS).all()


def test_late_commands_arrive_as_those_of_a_single_twin(pepper):
    delays = np.array([0.0, 0.003, 0.011, 0.04])
    batch = TwinBatch(pepper, 4, vary={"latency": delays})
    targets = targets_of(pepper, 5)[:, :4]
    for target in targets:
        batch.step(target, STEPS, commands="linear")
    for row, delay in enumerate(delays):
        late = actuator_parameters(pepper).changed(latency=delay)
        state = single_run(pepper, Twin(pepper, actuators=late), targets[:, row])
        np.testing.assert_allclose(batch.position[row], state.position, atol=1e-9)
    with pytest.raises(InvalidValueError, match="step"):
        batch.follow(targets[0, 0][None])
    slow = TwinBatch(pepper, 2, actuators=actuator_parameters(pepper).changed(latency=1.5))
    assert slow.follow(np.tile(pepper.neutral(), (3, 1))).success.all()
    with pytest.raises(InvalidValueError, match="latency"):
        slow.step(pepper.neutral())


def test_loads_from_outside_act_as_on_a_single_twin(pepper):
    batch = TwinBatch(pepper, 3)
    force = np.array([0.0, 20.0, 0.0, 0.0, 0.0, 0.0])
    pushes = np.stack([k * external_torque(pepper, pepper.neutral(), {"l_hand": force}) for k in range(3)])
    target = pepper.neutral()
    for _ in range(4):
        batch.step(target, STEPS, load=pushes, commands="linear")
    for row in range(3):
        state = single_run(pepper, Twin(pepper), [target] * 4, pushes[row])
        np.testing.assert_allclose(batch.position[row], state.position, atol=1e-9)
    hand = frame_pose(pepper, batch.position, "l_hand")[:, 1, 3]
    assert hand[2] > hand[1] > hand[0]


@pytest.mark.parametrize("late", [False, True])
def test_checkpoints_repeat_to_the_bit(pepper, late):
    actuators = actuator_parameters(pepper).changed(backlash=0.01)
    options = {"vary": {"latency": np.linspace(0.0, 0.03, 5)}} if late else {}
    batches = [TwinBatch(pepper, 5, world=world_of(pepper), actuators=actuators, **options) for _ in range(2)]
    targets = targets_of(pepper, 5)[:, :5]
    for target in targets[:3]:
        batches[0].step(target, STEPS)
    kept = batches[0].checkpoint()
    batches[1].restore(kept)
    for twins in batches:
        for target in targets[3:]:
            twins.step(target, STEPS)
    for name, part in batches[0].checkpoint().items():
        np.testing.assert_array_equal(part, batches[1].checkpoint()[name], err_msg=name)
    batches[0].restore(kept)
    np.testing.assert_array_equal(batches[0].checkpoint()["position"], kept["position"])
    with pytest.raises(InvalidValueError, match="checkpoint's velocity"):
        batches[0].restore({**kept, "velocity": np.zeros(3)})


def test_misuse_is_refused(pepper):
    with pytest.raises(InvalidValueError, match="world"):
        TwinBatch(pepper, 2, world=World(None))
    with pytest.raises(InvalidValueError, match="vary_bodies"):
        TwinBatch(pepper, 2, vary_bodies={"ball": {"mass": 1.0}})
    with pytest.raises(UnknownNameError, match="parcel"):
        TwinBatch(pepper, 2, world=world_of(pepper), vary_bodies={"box": {"mass": 1.0}})
    with pytest.raises(UnknownNameError, match="friction"):
        TwinBatch(pepper, 2, world=world_of(pepper), vary_bodies={"ball": {"color": 1.0}})
    with pytest.raises(InvalidValueError, match="mass of 'ball'"):
        TwinBatch(pepper, 2, world=world_of(pepper), vary_bodies={"ball": {"mass": [1.0, -1.0]}})
    with pytest.raises(InvalidValueError, match="latency"):
        TwinBatch(pepper, 2, vary={"latency": [0.0, -0.1]})
    batch = TwinBatch(pepper, 2, world=world_of(pepper))
    with pytest.raises(UnknownNameError, match="ball"):
        batch.body("bell")
    with pytest.raises(InvalidValueError, match="position of 'ball'"):
        batch.place("ball", (np.nan, 0.0, 0.0))
    with pytest.raises(InvalidValueError, match="commands"):
        batch.step(pepper.neutral(), commands="sudden")
    with pytest.raises(InvalidValueError, match="load"):
        batch.step(pepper.neutral(), load=np.zeros(3))
    with pytest.raises(InvalidValueError, match="step"):
        batch.follow(pepper.neutral()[None])


@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_no_point_moves_farther_than_its_lever_says(base):
    robot = pk.load_pepper(base=base)
    levers = World(robot).levers()
    rng = np.random.default_rng(6)
    low, high = np.maximum(robot.lower_limits, -3.0), np.minimum(robot.upper_limits, 3.0)
    frames = [name for name in robot.frame_names if name != "universe"]
    nearest = np.zeros(robot.n)
    for _ in range(20):
        q = rng.uniform(low, high)
        for j in range(robot.n):
            other = q.copy()
            other[j] += 1e-4
            moved = [
                np.linalg.norm((frame_pose(robot, other, f) - frame_pose(robot, q, f))[:3, 3]) for f in frames
            ]
            assert max(moved) <= 1e-4 * levers[j] + 1e-9, robot.joint_names[j]
            nearest[j] = max(nearest[j], max(moved) / 1e-4 / levers[j])
    assert nearest.min() > 0.1  # and not much less
