"""Infos of vector environments beside those of Gymnasium's own, step by step."""

import gymnasium
import numpy as np
import pytest

from pepper_kin.learning import PepperVectorEnv

MODES = {
    "SameStep": gymnasium.vector.AutoresetMode.SAME_STEP,
    "NextStep": gymnasium.vector.AutoresetMode.NEXT_STEP,
}
OWN = ("diverged", "_diverged")


def about(infos):
    """Names, and for masks and flags their values, without what Gymnasium's do not have."""
    found = {}
    for name, value in infos.items():
        if isinstance(value, dict):
            found[name] = about(value)
        elif name not in OWN:
            found[name] = np.asarray(value).tolist() if name.startswith("_") else None
    return found


@pytest.mark.parametrize("mode", MODES)
def test_infos_are_gymnasium_s(mode):
    """Over an end, which half of the robots reach earlier because they began earlier."""
    makers = [lambda: gymnasium.make("pepper_kin.learning:PepperReach-v0")] * 2
    ours = PepperVectorEnv(2, "Reach", autoreset_mode=mode)
    theirs = gymnasium.vector.SyncVectorEnv(makers, autoreset_mode=MODES[mode])
    rows = []
    for environment in (ours, theirs):
        environment.reset(seed=[1, 2])
        rows.append([environment.step(np.zeros((2, 5), np.float32))[4] for _ in range(52)])
    for step, (first, second) in enumerate(zip(*rows, strict=True)):
        assert about(first) == about(second), step
    last, values = rows[0][49], rows[1][49]
    if mode == "SameStep":
        assert "distance" not in last
        last, values = last["final_info"], values["final_info"]
    assert last["is_success"].tolist() == values["is_success"].tolist()


def test_infos_of_some_that_end():
    """Where one ends, its numbers are in `final_info` alone, and those of the others at the top."""
    env = PepperVectorEnv(2, "Reach", autoreset_mode="SameStep")
    env.reset(seed=[1, 2])
    for _ in range(20):
        env.step(np.zeros((2, 5), np.float32))
    env.elapsed[0] = 49
    _, _, terminated, truncated, infos = env.step(np.zeros((2, 5), np.float32))
    assert (terminated | truncated).tolist() == [True, False]
    assert infos["_distance"].tolist() == [False, True]
    assert infos["final_info"]["_distance"].tolist() == [True, False]
    assert infos["distance"][0] == infos["final_info"]["distance"][1] == 0.0
    assert min(infos["distance"][1], infos["final_info"]["distance"][0]) > 0.0
