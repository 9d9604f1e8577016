"""Environments of Gymnasium: interfaces, modes, seeds, and tasks that can be solved."""

import importlib
import importlib.metadata
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import pepper_kin as pk
from pepper_kin import learning
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError, UnknownNameError
from pepper_kin.learning import Oracle, PepperVectorEnv

ENDS = 50


def success_of(env, policy, episodes):
    """Return the share of episodes that end in success."""
    env.reset(seed=5)
    ends = []
    while len(ends) < episodes:
        *_, terminated, truncated, infos = env.step(policy())
        ended = terminated | truncated
        if ended.any():
            ends += infos["final_info"]["is_success"][ended].tolist()
    return np.mean(ends)


@pytest.mark.thorough
@pytest.mark.parametrize("name", list(learning.TASKS))
def test_a_task_can_be_solved_and_not_by_chance(name):
    env = PepperVectorEnv(120, name, autoreset_mode=AutoresetMode.SAME_STEP)
    assert success_of(env, Oracle(env), 120) >= 0.97
    drawn = np.random.default_rng(0)
    assert success_of(env, lambda: drawn.uniform(-1, 1, env.action_space.shape), 120) <= 0.05


def test_the_oracle_finds_tasks_that_cannot_be_solved():
    env = PepperVectorEnv(50, "Reach", autoreset_mode=AutoresetMode.SAME_STEP)
    env._bank = env._bank + np.array([0.4, 0.0, 0.0])  # beyond the arm's reach
    assert success_of(env, Oracle(env), 100) < 0.5


@pytest.mark.thorough
def test_robots_that_only_stand_tip_over_and_those_that_drive_blindly_touch():
    env = PepperVectorEnv(40, "Balance", autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=1)
    lost = np.zeros(40, bool)
    for _ in range(100):
        _, rewards, terminated, *_ = env.step(np.zeros((40, 3)))
        lost |= terminated
    assert lost.all()
    env = PepperVectorEnv(40, "Drive", autoreset_mode=AutoresetMode.SAME_STEP)
    env.reset(seed=1)
    for _ in range(500):
        _, rewards, terminated, _, infos = env.step(np.tile([1.0, 0.0, 0.0], (40, 1)))
        if terminated.any():
            break
    nearest = infos["final_obs"][terminated][:, -51:-6].min()
    assert 0.05 < 3.0 * nearest < 0.4  # [m]: lasers have seen what was touched, from the base
    assert rewards[terminated].max() < -100.0


def test_things_that_are_pushed_or_touched_are_where_the_worlds_have_them():
    env = PepperVectorEnv(6, "Push", autoreset_mode=AutoresetMode.SAME_STEP)
    env.reset(seed=2)
    start, oracle = env.episode[:, 3:5].copy(), Oracle(env)
    np.testing.assert_allclose(env.twins.body("box").position[:, :2], start)
    for _ in range(140):
        _, _, _, _, infos = env.step(oracle())
    box = env.twins.body("box").position
    np.testing.assert_allclose(
        np.linalg.norm(box - env.episode[:, :3], axis=1), infos["distance"], atol=1e-12
    )
    assert (box[:, 0] - start[:, 0]).min() > 0.02
    assert np.abs(box[:, 2] - env.episode[:, 2]).max() < 0.01  # on the table


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:.*Box observation space.*")
@pytest.mark.parametrize("options", [{}, {"sparse": True, "goal_form": True}])
@pytest.mark.parametrize("name", list(learning.TASKS))
def test_gymnasium_accepts_the_environments(name, options):
    check_env(gymnasium.make(f"Pepper{name}-v0", **options).unwrapped, skip_render_check=True)
    many = gymnasium.make_vec(
        f"Pepper{name}-v0", num_envs=3, vectorization_mode="vector_entry_point", **options
    )
    observations, _ = gymnasium.wrappers.vector.RecordEpisodeStatistics(many).reset(seed=3)
    assert many.observation_space.contains(observations)
    observations, rewards, terminated, truncated, _ = many.step(many.action_space.sample())
    assert many.observation_space.contains(observations)
    assert rewards.shape == terminated.shape == truncated.shape == (3,)


def run(env, actions, steps):
    env.reset(seed=7)
    return [env.step(actions[k % len(actions)]) for k in range(steps)]


def test_episodes_end_as_each_mode_says():
    actions = np.random.default_rng(1).uniform(-1, 1, (7, 4, 5))
    envs = {mode: PepperVectorEnv(4, autoreset_mode=mode) for mode in AutoresetMode}
    runs = {mode: run(env, actions, ENDS) for mode, env in envs.items()}
    before, last = runs[AutoresetMode.NEXT_STEP], runs[AutoresetMode.SAME_STEP][-1]
    assert not any(step[3].any() for step in before[:-1])
    assert before[-1][3].all()
    np.testing.assert_array_equal(last[4]["final_obs"], before[-1][0])
    np.testing.assert_array_equal(last[1], before[-1][1])
    assert last[4]["_final_obs"].all()
    home = envs[AutoresetMode.NEXT_STEP].pepper.neutral()
    np.testing.assert_array_equal(envs[AutoresetMode.SAME_STEP].twins.position, np.tile(home, (4, 1)))
    observations, rewards, _, truncated, _ = envs[AutoresetMode.NEXT_STEP].step(actions[0])
    np.testing.assert_array_equal(observations, last[0])
    assert not rewards.any()
    assert not truncated.any()
    stopped = envs[AutoresetMode.DISABLED]
    mask = np.array([True, False, False, True])
    kept = stopped.twins.position
    stopped.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(stopped.twins.position[~mask], kept[~mask])
    np.testing.assert_array_equal(stopped.twins.position[mask], np.tile(home, (2, 1)))


@pytest.mark.thorough
@pytest.mark.parametrize("name", list(learning.TASKS))
def test_every_task_ends_and_begins_in_every_mode(name):
    found = {}
    for mode in AutoresetMode:
        env = PepperVectorEnv(3, name, autoreset_mode=mode)
        first, _ = env.reset(seed=9)
        zero = np.zeros(env.action_space.shape)
        env.elapsed[:] = env.task.horizon - 2
        _, _, _, before, _ = env.step(zero)
        last, rewards, terminated, truncated, infos = env.step(zero)
        assert not before.any()
        assert (truncated | terminated).all()
        if mode is AutoresetMode.SAME_STEP:
            last, second = infos["final_obs"], last
        elif mode is AutoresetMode.NEXT_STEP:
            second, rewards_of_reset, *_ = env.step(zero)
            assert not rewards_of_reset.any()
        else:
            second, _ = env.reset(options={"reset_mask": np.ones(3, bool)})
        assert env.observation_space.contains(second)
        found[mode] = (first, last, rewards, second)
    for one, other in zip(found[AutoresetMode.NEXT_STEP], found[AutoresetMode.SAME_STEP], strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(found[AutoresetMode.NEXT_STEP], found[AutoresetMode.DISABLED], strict=True):
        np.testing.assert_array_equal(one, other)


def test_seeds_repeat_whatever_the_number_of_robots():
    few, many = PepperVectorEnv(3), PepperVectorEnv(9)
    np.testing.assert_array_equal(few.reset(seed=11)[0], many.reset(seed=11)[0][:3])
    assert len(np.unique(many.episode.round(9), axis=0)) > 6
    again = many.reset(seed=11)[0]
    np.testing.assert_array_equal(again[:3], few.reset(seed=11)[0])
    assert not np.array_equal(many.reset(seed=12)[0], again)
    single = [PepperVectorEnv(1).reset(seed=[s])[0] for s in (4, 5)]
    np.testing.assert_array_equal(few.reset(seed=[4, 5, 4])[0], np.concatenate([*single, single[0]]))


def test_rewards_of_the_goal_form_can_be_computed_again():
    for sparse in (False, True):
        env = PepperVectorEnv(6, "ReachBoth", goal_form=True, sparse=sparse)
        env.reset(seed=0)
        for _ in range(3):
            observations, rewards, *_ = env.step(env.action_space.sample())
        again = env.compute_reward(observations["achieved_goal"], observations["desired_goal"], {})
        np.testing.assert_allclose(rewards, again, atol=1e-6)


def test_robots_differ_by_their_randomization():
    env = PepperVectorEnv(8, randomization={"stiffness": (0.5, 2.0)})
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.ones((8, 5)))
    assert np.ptp(env.twins.position[:, env.joints], axis=0).max() > 1e-3
    usual = PepperVectorEnv(8)
    usual.reset(seed=0)
    for _ in range(5):
        usual.step(np.ones((8, 5)))
    assert np.ptp(usual.twins.position[:, usual.joints], axis=0).max() == 0.0


def test_ranges_of_robots_are_those_that_were_measured_or_given():
    usual, drawn = learning.Randomization(), PepperVectorEnv(400, randomization=learning.Randomization())
    pepper = drawn.pepper
    options = usual.drawn(pepper, 400, 0)
    stiffness, j = options["vary"]["stiffness"], pepper.joint_index("LElbowRoll")
    assert 118.0 <= stiffness[:, j].min() < 121.0  # the sag of settled joints, see docs/validation.md
    assert 217.0 < stiffness[:, j].max() <= 220.0
    assert np.ptp(stiffness[:, pepper.joint_index("HeadYaw")]) == 0.0
    assert 0.0 <= options["vary"]["latency"].min() < options["vary"]["latency"].max() <= 0.02
    given = {"mass": (0.9, 1.1), "stiffness": {"HeadYaw": (1.0, 2.0)}, "latency": (0.01, 0.04)}
    options = learning.Randomization(given).drawn(pepper, 400, 0)
    assert np.ptp(options["vary"]["stiffness"][:, j]) == 0.0
    assert np.ptp(options["mass_scale"]["HeadYaw"]) > 0.15
    assert options["vary"]["latency"].min() >= 0.01
    again = learning.Randomization(given).drawn(pepper, 400, 0)
    np.testing.assert_array_equal(options["vary"]["latency"], again["vary"]["latency"])
    with pytest.raises(UnknownNameError, match="stiffness"):
        learning.Randomization({"stifness": (0.5, 2.0)})
    with pytest.raises(InvalidValueError, match="range of mass"):
        learning.Randomization({"mass": (-0.5, 2.0)})
    with pytest.raises(InvalidValueError, match="range of latency"):
        learning.Randomization({"latency": (0.3, 0.2)})


class _Loose(learning.ReachTask):
    """A task whose arrays are of other kinds and orders than the machine code takes."""

    def episodes(self, pepper, speed, period, seed):
        return np.asfortranarray(super().episodes(pepper, speed, period, seed), np.float32)

    def achieved_goal(self, state):
        return np.asfortranarray(super().achieved_goal(state))

    def score(self, state, achieved, desired):
        found = super().score(state, achieved, desired)
        return found._replace(distance=found.distance.astype(np.float32), success=found.success.tolist())


def test_arrays_of_a_task_of_ones_own_may_be_of_any_kind():
    plain, loose = (PepperVectorEnv(3, kind("mine")) for kind in (learning.ReachTask, _Loose))
    for env in (plain, loose):
        env.reset(seed=4)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5))
    for found, wanted in zip(loose.step(actions)[:4], plain.step(actions)[:4], strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_a_state_is_a_value_and_oracles_do_not_disturb_each_other():
    env = PepperVectorEnv(3, autoreset_mode=AutoresetMode.SAME_STEP)
    env.reset(seed=4)
    first, early = env.state, Oracle(env)
    kept = [np.copy(part) for part in (first.position, first.episode, first.begun, first.elapsed)]
    for _ in range(5):
        env.step(early())
    for part, old in zip((first.position, first.episode, first.begun, first.elapsed), kept, strict=True):
        np.testing.assert_array_equal(part, old)
    assert (env.state.position != first.position).any()
    np.testing.assert_array_equal(env.state.time, np.full(3, 0.1))
    np.testing.assert_allclose(Oracle(env)(), early(), atol=1e-9)
    env.elapsed[1] = env.task.horizon - 1
    env.step(early())
    np.testing.assert_array_equal(env.state.begun, kept[2] + [0, 1, 0])
    assert np.abs(Oracle(env)() - early()).max() < 1e-9


def test_misuse_is_refused():
    env = PepperVectorEnv(4)
    with pytest.raises(InvalidValueError, match="seed"):
        env.reset(seed=[1, -1, None, 2])
    with pytest.raises(InvalidValueError, match="before reset"):
        env.step(np.zeros((4, 5)))
    env.reset(seed=0)
    wrong = np.zeros((4, 5))
    wrong[2, 1] = np.nan
    with pytest.raises(InvalidValueError, match="environment 2"):
        env.step(wrong)
    with pytest.raises(InvalidValueError, match="shape"):
        env.step(np.zeros((3, 5)))
    with pytest.raises(InvalidValueError, match="reset_mask"):
        env.reset(options={"reset_mask": np.ones(3, bool)})
    with pytest.raises(UnknownNameError, match="Reach"):
        PepperVectorEnv(4, "Raech")
    with pytest.raises(InvalidValueError, match="no goal"):
        PepperVectorEnv(4, speed=1e-6)
    package = importlib.metadata.distribution("example-robot-data")
    files = package.files or ()
    panda = next(file for file in files if str(file).endswith("panda_description/urdf/panda.urdf"))
    robot = pk.load_robot(package.locate_file(panda))
    with pytest.raises(UnknownNameError):
        PepperVectorEnv(4, pepper=robot)


def test_without_gymnasium_the_command_that_installs_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in [name for name in sys.modules if name.startswith("pepper_kin.learning")]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(MissingDependencyError, match=r"pepper_kin\[learning\]"):
        importlib.import_module("pepper_kin.learning")
