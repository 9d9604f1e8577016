"""Pictures of environments: what they show, and the wrappers of Gymnasium that film them."""

import av
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo
from gymnasium.wrappers import vector as vector_wrappers

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning import PepperVectorEnv


def is_goal(picture):
    """Return which pixels have the color of the goals, which nothing else has."""
    red, green, blue = (picture[..., k].astype(int) for k in range(3))
    return (red > 2 * green) & (red > 2 * blue) & (red > 60)


@pytest.mark.thorough
def test_a_picture_shows_robot_and_goals_where_they_are():
    env = PepperVectorEnv(18, "ReachBoth", render_mode="rgb_array")
    env.reset(seed=0)
    pictures = env.render()
    assert len(pictures) == 18
    assert {picture.shape for picture in pictures} == {(320, 320, 3)}
    assert {picture.dtype for picture in pictures} == {np.dtype(np.uint8)}
    white = (pictures[0].min(axis=2) > 190) & (np.ptp(pictures[0], axis=2) < 8)
    assert 0.04 < white.mean() < 0.2  # the body
    env.episode[0] = [0.2, 0.45, 0.9, 0.2, -0.45, 0.9]
    columns = np.flatnonzero(is_goal(env.render()[0]).any(axis=0))
    apart = np.flatnonzero(np.diff(columns) > 20)
    assert apart.size == 1  # two balls side by side; the robot's left is on the right
    env.episode[0, :3] = 0.4, 0.3, 1.1
    env.episode[0, 3:] = 0.0, 0.0, -5.0  # below the floor
    high = np.flatnonzero(is_goal(env.render()[0]).any(axis=1)).mean()
    env.episode[0, 2] = 0.7
    assert np.flatnonzero(is_goal(env.render()[0]).any(axis=1)).mean() > high + 40
    before = env.render()
    env.step(np.ones(env.action_space.shape))
    after = env.render()
    assert (before[0] != after[0]).any(axis=2).sum() > 50
    assert np.ptp(after[17]) == 0  # beyond the first 16
    assert PepperVectorEnv(1).render() is None
    with pytest.raises(InvalidValueError, match="rgb_array"):
        PepperVectorEnv(1, render_mode="human")


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:.*Box observation space.*")
def test_gymnasium_films_an_episode(tmp_path):
    check_env(gymnasium.make("PepperReach-v0", render_mode="rgb_array").unwrapped)
    made = gymnasium.make("PepperReach-v0", render_mode="rgb_array", max_episode_steps=4)
    env = RecordEpisodeStatistics(RecordVideo(made, str(tmp_path)))
    env.reset(seed=0)
    for _ in range(4):
        *_, info = env.step(np.ones(5))
    env.close()
    assert info["episode"]["l"] == 4
    (film,) = tmp_path.glob("*.mp4")
    with av.open(film) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        assert container.streams.video[0].average_rate == 50
    assert len(frames) == 5
    assert frames[0].shape == (320, 320, 3)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100


@pytest.mark.thorough
def test_gymnasium_films_a_batch(tmp_path):
    many = gymnasium.make_vec(
        "PepperReach-v0", num_envs=3, vectorization_mode="vector_entry_point", render_mode="rgb_array"
    )
    env = vector_wrappers.RecordVideo(many, str(tmp_path), video_length=2)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros((3, 5)))
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    with av.open(film) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) >= 2
    assert frames[0].size >= 3 * 320 * 320 * 3  # all three, side by side
