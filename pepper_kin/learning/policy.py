"""Policies as small networks in NumPy: actions, files, and success rate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access.atomic_file import PathName
from pepper_kin.file_access.numpy_archive import read_arrays, write_arrays
from pepper_kin.learning.vector_env import PepperVectorEnv, ended_values
from pepper_kin.model.joint_vectors import as_finite

Floats = NDArray[np.float32]

FORMAT = "pepper_kin policy 1"
_OF_ALL = ("format", "task", "center", "scale")


@dataclass(frozen=True, eq=False)
class Policy(FrozenArrays):
    """Network from observations to actions: tanh layers, the last one linear and clipped.

    x' = (x - center) / scale,   x' = tanh(x' W + b) except in the last,   action = clip(x' W + b, -1, 1).

    Attributes:
        task: Name of the task for which it was trained.
        center: Center of the observations, shape (obs,).
        scale: Scale of the observations, above 0, shape (obs,).
        weights: W of each layer, shape (inputs, outputs); the first has obs inputs, the last k outputs.
        biases: b of each layer, shape (outputs,).

    Raises:
        InvalidValueError: for shapes that do not fit, NaN, or a scale that is not above 0.
    """

    task: str
    center: Floats
    scale: Floats
    weights: tuple[Floats, ...]
    biases: tuple[Floats, ...]

    def __post_init__(self) -> None:
        """Copy and check the arrays."""
        sizes = [len(np.atleast_1d(self.center)), *(len(np.atleast_1d(bias)) for bias in self.biases)]
        if not self.biases or len(self.weights) != len(self.biases):
            allowed = f"as many as biases, {len(self.biases)}, and one at least"
            raise InvalidValueError("weights", f"{len(self.weights)} layers", allowed)

        def checked(value: ArrayLike, name: str, shape: tuple[int, ...]) -> Floats:
            return read_only(as_finite(value, name, shape, 1e30), np.float32)

        for name in ("center", "scale"):
            object.__setattr__(self, name, checked(getattr(self, name), name, (sizes[0],)))
        if not (self.scale > 0).all():
            raise InvalidValueError("scale", self.scale.min(), "numbers above 0")
        layers = enumerate(zip(self.weights, pairwise(sizes), strict=True))
        weights = tuple(checked(weight, f"weight {k}", shape) for k, (weight, shape) in layers)
        biases = tuple(checked(b, f"bias {k}", (sizes[k + 1],)) for k, b in enumerate(self.biases))
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "biases", biases)

    def __call__(self, observations: ArrayLike) -> Floats:
        """Return the actions for observations, shape (N, obs) to (N, k), or (obs,) to (k,).

        Raises:
            InvalidValueError: for observations of another length.
        """
        x = np.asarray(observations, np.float32)
        if x.ndim not in (1, 2) or x.shape[-1] != self.center.size:
            allowed = f"shape (N, {self.center.size}), as those of {self.task}"
            raise InvalidValueError("observations", f"shape {x.shape}", allowed)
        x = (x - self.center) / self.scale
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.tanh(x @ weight + bias)
        return np.clip(x @ self.weights[-1] + self.biases[-1], -1.0, 1.0)

    def save(self, path: PathName) -> Path:
        """Write the policy as a NumPy archive, whole or not at all; return its path.

        Raises:
            FileFormatError: if the file cannot be written.
        """
        layers = {f"weight_{k}": weight for k, weight in enumerate(self.weights)}
        layers |= {f"bias_{k}": bias for k, bias in enumerate(self.biases)}
        named = {"format": FORMAT, "task": self.task, "center": self.center, "scale": self.scale}
        return write_arrays(path, {**named, **layers}, compressed=False)

    @classmethod
    def of_sb3(cls, model: Any, task: str) -> Policy:
        """Return the policy of a PPO of stable-baselines3, without its noise.

        Args:
            model: `PPO("MlpPolicy", ...)` with tanh layers.  The normalization of observations by a
                `VecNormalize` around its environments is kept, but not its clipping.
            task: Name of the task for which it was trained.

        Raises:
            InvalidValueError: for another kind of network.
        """
        net = model.policy
        if not (hasattr(net, "action_net") and type(net.features_extractor).__name__ == "FlattenExtractor"):
            raise InvalidValueError("model", type(net).__name__, "a PPO with MlpPolicy")
        layers = list(net.mlp_extractor.policy_net)
        linear, other = layers[::2], {type(layer).__name__ for layer in layers[1::2]}
        if other - {"Tanh"} or net.squash_output:
            raise InvalidValueError("layers of the model", ", ".join(sorted(other)), "Tanh, not squashed")
        arrays = [
            (layer.weight.detach().cpu().numpy().T, layer.bias.detach().cpu().numpy())
            for layer in (*linear, net.action_net)
        ]
        weights, biases = zip(*arrays, strict=True)
        center, scale = np.zeros(len(weights[0]), np.float32), np.ones(len(weights[0]), np.float32)
        normalized = model.get_vec_normalize_env()
        if normalized is not None and normalized.norm_obs:
            seen = normalized.obs_rms
            center = np.asarray(seen.mean, np.float32)
            scale = np.asarray(np.sqrt(seen.var + normalized.epsilon), np.float32)
        return cls(task, center, scale, weights, biases)


def load_policy(path: PathName) -> Policy:
    """Return the policy in a file; nothing in it is executed.

    Raises:
        FileFormatError: naming the file, if it cannot be read, is damaged, or does not hold a policy.
    """
    arrays = read_arrays(path)
    if str(arrays.get("format")) != FORMAT:
        raise FileFormatError(path, f"is no policy: expected the format {FORMAT!r}")
    count = sum(name.startswith("weight_") for name in arrays)
    layers = [[f"{name}_{k}" for k in range(count)] for name in ("weight", "bias")]
    if missing := sorted({*_OF_ALL, *layers[0], *layers[1]} ^ {*arrays}):
        raise FileFormatError(path, f"is damaged: {', '.join(missing)} missing or too much")
    try:
        weights, biases = (tuple(arrays[name] for name in names) for names in layers)
        return Policy(str(arrays["task"]), arrays["center"], arrays["scale"], weights, biases)
    except InvalidValueError as error:
        raise FileFormatError(path, f"is damaged: {error}") from error


def success_rate(env: PepperVectorEnv, policy: Callable[[Any], ArrayLike], *, seed: int = 1) -> float:
    """Return the fraction of robots whose next episode ends in success, from 0 to 1.

    Args:
        env: The environments, which are reset.
        policy: Function from observations to actions, such as a `Policy`.
        seed: Seed of the goals.
    """
    observations, _ = env.reset(seed=seed)
    done, reached = np.zeros(env.num_envs, bool), np.zeros(env.num_envs, bool)
    while not done.all():
        observations, _, terminated, truncated, infos = env.step(policy(observations))
        ended = (terminated | truncated) & ~done
        reached |= ended_values(infos, "is_success", ended) > 0
        done |= ended
    return float(reached.mean())
