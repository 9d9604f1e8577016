"""Base parameters: the combinations of inertial parameters that determine joint torques."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin import dynamics
from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel

QUANTITIES = ("m", "mc_x", "mc_y", "mc_z", "I_xx", "I_xy", "I_yy", "I_xz", "I_yz", "I_zz")
"""Parameters of a body in the order of `dynamics.inertial_parameters`."""

UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)

_STATES = 300
_RANK = 1e-8  # relative remainder of a column below which it depends on the columns before it


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """A maximum set of inertial parameters that torques distinguish; other parameters are grouped into them.

    Gautier, Numerical calculation of the base inertial parameters of robots (1991): columns of the regressor
    at random states that are linearly independent of the columns before them, by QR decomposition.

    Attributes:
        names: Names of the r parameters, `<joint of the body>.<quantity>` and `<joint>.rotor`.
        units: Units of the parameters.
        columns: Indices of their columns in `torque_columns`, shape (r,).
        grouping: Matrix with beta = grouping pi, shape (r, 10 bodies).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: NDArray[np.intp]
    grouping: Array

    def of(self, pepper: PepperModel) -> Array:
        """Return the values of the parameters in a robot's description, shape (r,) [kg, kg m, kg m^2]."""
        return np.asarray(self.grouping @ dynamics.inertial_parameters(pepper))


def torque_columns(pepper: PepperModel, moving: list[int], q: Array, v: Array, a: Array) -> Array:
    """Return the regressor of k joints' torques, shape (T, k, 10 bodies + k).

    The columns of the bodies come first, then the columns of the joints' rotor inertias behind the gears.
    """
    rows = dynamics.regressor(pepper, q, v, a)[:, moving]
    return np.concatenate([rows, np.eye(len(moving)) * a[:, None, moving]], axis=2)


def base_parameters(pepper: PepperModel, joints: tuple[str, ...], rest: Array) -> BaseParameters:
    """Return the base parameters of joints that move while all others are at rest."""
    random = np.random.default_rng(0)
    moving = [pepper.joint_index(joint) for joint in joints]
    low = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, -np.pi)
    high = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, np.pi)
    state = np.zeros((3, _STATES, pepper.n))
    state[0] = rest
    state[:, :, moving] = random.uniform(-3.0, 3.0, (3, _STATES, len(moving)))
    state[0][:, moving] = random.uniform(low[moving], high[moving], (_STATES, len(moving)))
    stacked = torque_columns(pepper, moving, state[0], state[1], state[2])
    stacked = stacked.reshape(-1, stacked.shape[2])
    size = np.linalg.norm(stacked, axis=0)
    used = np.flatnonzero(size > _RANK * size.max())
    stacked = stacked[:, used] / size[used]
    free = np.abs(np.diag(np.linalg.qr(stacked, mode="r"))) > _RANK
    columns = used[free]
    grouping = np.zeros((columns.size, size.size))
    grouping[:, used] = np.linalg.lstsq(stacked[:, free], stacked, rcond=None)[0] * size[used]
    grouping /= size[columns][:, None]
    every = [f"{body}.{quantity}" for body in list(pepper.inner_model.names)[1:] for quantity in QUANTITIES]
    of_bodies = len(every)
    every += [f"{joint}.rotor" for joint in joints]
    rotors = ["kg m^2" if pepper.joint_units[j] == "rad" else "kg" for j in moving]
    units = (*UNITS * (of_bodies // 10), *rotors)
    return BaseParameters(
        tuple(every[c] for c in columns),
        tuple(units[c] for c in columns),
        columns,
        grouping[:, :of_bodies],
    )
