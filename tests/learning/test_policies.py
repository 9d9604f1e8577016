"""Policies: what networks compute, their files, imitation, and episodes on other robots."""

import io
import sys
from itertools import pairwise

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import learning
from pepper_kin.exceptions import FileFormatError, InvalidValueError, MissingDependencyError, UnknownNameError
from pepper_kin.learning import (
    Oracle,
    PepperVectorEnv,
    Policy,
    imitate,
    load_policy,
    run_policy,
    success_rate,
)
from pepper_kin.naoqi import Broker


@pytest.fixture(scope="module")
def trained():
    """A policy of Reach, and what was told of its rounds."""
    told = []
    policy = imitate(PepperVectorEnv(200, "Reach"), rounds=4, on_round=told.append)
    return policy, told


def drawn_policy(sizes=(4, 6, 5, 2)):
    rng = np.random.default_rng(0)
    weights = [rng.normal(size=pair) for pair in pairwise(sizes)]
    biases = [rng.normal(size=size) for size in sizes[1:]]
    return Policy("Reach", rng.normal(size=4), rng.uniform(0.5, 2, 4), tuple(weights), tuple(biases))


def test_a_policy_is_the_network_of_its_formula():
    policy, x = drawn_policy(), np.random.default_rng(1).normal(size=(9, 4))
    y = (x - policy.center) / policy.scale
    for k in range(2):
        y = np.tanh(y @ policy.weights[k] + policy.biases[k])
    y = y @ policy.weights[2] + policy.biases[2]
    assert (np.abs(y) > 1).any()
    np.testing.assert_allclose(policy(x), np.clip(y, -1, 1), atol=1e-5)
    np.testing.assert_allclose(policy(x[3]), policy(x)[3], atol=1e-6)
    with pytest.raises(InvalidValueError, match=r"observations: .*shape \(N, 4\), as those of Reach"):
        policy(np.zeros((2, 5)))


def test_a_file_gives_the_same_policy_or_is_refused(tmp_path):
    policy, path = drawn_policy(), tmp_path / "policy.npz"
    assert policy.save(path) == path
    again, x = load_policy(path), np.linspace(-1, 1, 8).reshape(2, 4)
    assert again.task == "Reach"
    np.testing.assert_array_equal(again(x), policy(x))
    with pytest.raises(FileFormatError, match="missing"):
        policy.save(tmp_path / "missing" / "policy.npz")
    whole = path.read_bytes()
    with np.load(path) as file:
        arrays = dict(file)

    def written(**changed):
        content = io.BytesIO()
        np.savez(content, **{k: v for k, v in (arrays | changed).items() if v is not None})
        return content.getvalue()

    pickled = written(task=np.array([{}], dtype=object))
    for content, reason in [
        (whole[:-30], "complete NumPy archive"),
        (b"\x89PNG", "complete NumPy archive"),
        (pickled, "allow_pickle"),
        (written(format="another"), "is no policy"),
        (written(format=None), "is no policy"),
        (written(bias_1=None), "bias_1 missing"),
        (written(scale=np.zeros(4)), "scale: got 0.0"),
        (written(weight_1=np.zeros((6, 4))), r"weight 1"),
        (written(bias_2=np.full(2, np.nan)), "bias 2"),
    ]:
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=reason):
            load_policy(path)


@pytest.mark.thorough
def test_imitation_reaches_new_goals_and_repeats_itself(trained):
    policy, told = trained
    assert [(found.done, found.total) for found in told] == [(k, 4) for k in (1, 2, 3, 4)]
    assert told[0].success > 0.95  # the teacher's
    np.testing.assert_array_equal(told[-1].policy.weights[0], policy.weights[0])
    others = PepperVectorEnv(200, "Reach", goal_seed=1)
    assert success_rate(others, policy) > 0.9
    assert success_rate(others, lambda x: -policy(x)) < 0.1
    runs = [imitate(PepperVectorEnv(8, "GazeReach"), rounds=1, hidden=(16,), seed=5) for _ in range(2)]
    assert [weight.shape for weight in runs[0].weights] == [(20, 16), (16, 7)]
    np.testing.assert_allclose(runs[0].weights[0], runs[1].weights[0], atol=1e-6)


@pytest.mark.thorough
def test_a_teacher_of_ones_own_is_imitated():
    env = PepperVectorEnv(40, "Reach", autoreset_mode="SameStep")
    policy = imitate(env, lambda: np.full((40, 5), 0.25), rounds=8, hidden=(32,))
    observations, _ = env.reset(seed=3)
    assert np.abs(policy(observations) - 0.25).mean() < 0.1


def test_success_is_that_of_the_last_step_in_all_modes():
    rates = []
    for mode in ("NextStep", "SameStep"):
        env = PepperVectorEnv(60, "Reach", autoreset_mode=mode)
        oracle = Oracle(env)
        rates.append(success_rate(env, lambda _, oracle=oracle: oracle()))
    assert rates[0] == rates[1] > 0.95


def test_a_twin_does_what_the_batch_does():
    one, batch = (PepperVectorEnv(1, "Reach", goal_seed=1) for _ in range(2))
    actions = iter(np.random.default_rng(0).uniform(-1, 1, (100, 1, 5)))
    kept = []
    episode = run_policy(lambda _: kept.append(next(actions)) or kept[-1], one, pk.Twin(one.pepper), seed=4)
    batch.reset(seed=[4])
    distances = [batch.step(action)[-1]["distance"][0] for action in kept]
    np.testing.assert_allclose(episode.distances, distances, atol=1e-12)
    np.testing.assert_allclose(episode.motion.end, batch.twins.position[0], atol=1e-12)
    np.testing.assert_array_equal(
        episode.scene.objects["goal 1"].transform_object_to_world[:3, 3], batch.episode[0, :3]
    )
    with pytest.raises(InvalidValueError, match="before reset"):
        one.step(np.zeros((1, 5)))


@pytest.mark.thorough
def test_a_policy_works_with_latency_and_a_table_explains_a_failure(trained):
    policy, _ = trained
    one = PepperVectorEnv(1, "Reach", goal_seed=1)
    motors = pk.twin.actuator_parameters(one.pepper, "motor")
    late = pk.Twin(one.pepper, actuators=motors)
    assert motors.latency > 0
    assert sum(run_policy(policy, one, late, seed=seed).success for seed in range(8)) >= 7
    scene = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.5, 0.1, 0.8))
    barred = pk.Twin(one.pepper, world=pk.twin.world.World(one.pepper, scene))
    episodes = [run_policy(policy, one, barred, seed=seed) for seed in range(16)]
    failed = [episode.explanation(one.pepper, scene) for episode in episodes if not episode.success]
    assert failed
    assert all("ended in failure" in text for text in failed)
    assert any("clearance: VIOLATED" in text and "table" in text for text in failed)


@pytest.mark.thorough
def test_a_policy_works_through_set_angles(trained):
    policy, _ = trained
    one = PepperVectorEnv(1, "Reach", goal_seed=1)
    reached = 0
    with Broker(real_time=False, response="measured") as broker:
        for seed in range(6):
            begin = broker.body.time.now
            episode = run_policy(policy, one, broker.motion, seed=seed, wait=broker.body.time.sleep)
            assert broker.body.time.now - begin > 50 * 0.02
            assert episode.motion.duration == pytest.approx(1.0)
            reached += episode.success
    assert reached >= 4


def test_an_error_of_a_policy_stops_the_robot():
    one, calls = PepperVectorEnv(1, "Reach"), []

    def policy(observations):
        calls.append(observations)
        return np.full((1, 5), np.nan if len(calls) > 5 else 1.0)

    with Broker(real_time=False) as broker:
        with pytest.raises(InvalidValueError, match="action"):
            run_policy(policy, one, broker.motion, wait=broker.body.time.sleep)
        names = list(one.pepper.joint_names)
        at_error = np.array(broker.motion.getAngles(names, True))
        broker.body.time.sleep(2.0)
        assert np.abs(broker.motion.getAngles(names, True) - at_error).max() < 0.05


def test_misuse_of_policies_is_refused():
    one = PepperVectorEnv(1, "Reach")
    with pytest.raises(InvalidValueError, match="robot: got str, expected a Twin, or an ALMotion"):
        run_policy(drawn_policy(), one, "robot")
    with pytest.raises(InvalidValueError, match="2 environments"):
        run_policy(drawn_policy(), PepperVectorEnv(2, "Reach"), pk.Twin(one.pepper))
    with pytest.raises(InvalidValueError, match="timestep of the twin"):
        run_policy(drawn_policy(), one, pk.Twin(one.pepper, timestep=0.003))
    with pytest.raises(InvalidValueError, match="joints of the twin"):
        run_policy(drawn_policy(), one, pk.Twin(pk.load_pepper(hands="mimic")))
    with pytest.raises(InvalidValueError, match="goal_form"):
        imitate(PepperVectorEnv(2, "Reach", goal_form=True))
    with pytest.raises(InvalidValueError, match="rounds"):
        imitate(PepperVectorEnv(2, "Reach"), rounds=0)
    with pytest.raises(InvalidValueError, match="method: got magic, expected one of imitation, ppo"):
        learning.best_policy("Reach", "magic")
    with pytest.raises(UnknownNameError, match="Reach"):
        learning.best_policy("Raech")
    with pytest.raises(InvalidValueError, match="weights: got 1 layers"):
        Policy("Reach", np.zeros(2), np.ones(2), (np.zeros((2, 2)),), (np.zeros(2), np.zeros(2)))


@pytest.mark.thorough
def test_ctrl_c_keeps_the_best_so_far():
    told = []

    def interrupt_in_the_second(found):
        told.append(found)
        if found.done == 2:
            raise KeyboardInterrupt

    policy, whole = learning.best_policy("Reach", rounds=3, on_round=interrupt_in_the_second)
    assert not whole
    best = max(told, key=lambda found: (found.success, found.done))
    np.testing.assert_array_equal(policy.weights[0], best.policy.weights[0])

    def interrupt_at_once(found):
        raise KeyboardInterrupt

    env = PepperVectorEnv(4, "Reach")
    with pytest.raises(KeyboardInterrupt):
        imitate(env, rounds=3, on_round=interrupt_at_once)


@pytest.mark.parametrize(("call", "package"), [("to_rsl_rl", "rsl_rl"), ("to_sb3", "stable_baselines3")])
def test_without_a_learner_the_command_that_installs_it_is_named(monkeypatch, call, package):
    for name in (package, f"{package}.env", f"{package}.common.vec_env"):
        monkeypatch.setitem(sys.modules, name, None)
    hand_over = getattr(learning, call)
    with pytest.raises(MissingDependencyError, match=f"{call}.*pip install"):
        hand_over(PepperVectorEnv(2, autoreset_mode="SameStep"))
    with pytest.raises(InvalidValueError, match="SAME_STEP"):
        hand_over(PepperVectorEnv(2))


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["Carry", "Push", "Balance", "Drive"])
def test_a_single_twin_does_a_task_as_the_batch_does(name):
    env = PepperVectorEnv(1, name)
    oracle = Oracle(env)
    episode = run_policy(lambda _: oracle(), env, env.task.twin(env.pepper), seed=4)
    assert episode.success
    batch = PepperVectorEnv(1, name)
    batch.reset(seed=[4])
    teacher = Oracle(batch)
    distances = [batch.step(teacher())[4]["distance"][0] for _ in episode.distances]
    assert np.abs(episode.distances - distances).max() < (0.02 if name == "Push" else 1e-5)
