"""Functions of quantities by name."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import TYPE_CHECKING

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.balance import base_wrench, zero_moment_point
from pepper_kin.symbolic.center_of_mass import center_of_mass, center_of_mass_jacobian
from pepper_kin.symbolic.energy import kinetic_energy, potential_energy
from pepper_kin.symbolic.forward_dynamics import forward_dynamics
from pepper_kin.symbolic.forward_dynamics_derivatives import forward_dynamics_derivatives
from pepper_kin.symbolic.inverse_dynamics import gravity_torque, inverse_dynamics
from pepper_kin.symbolic.inverse_dynamics_derivatives import coriolis_matrix, inverse_dynamics_derivatives
from pepper_kin.symbolic.jacobians import frame_jacobian, frame_jacobian_rate
from pepper_kin.symbolic.mass_matrix import inverse_mass_matrix, mass_matrix
from pepper_kin.symbolic.momentum import centroidal_inertia, centroidal_map, centroidal_momentum
from pepper_kin.symbolic.poses import frame_pose, frame_poses
from pepper_kin.symbolic.regressor import regressor
from pepper_kin.symbolic.velocities import frame_acceleration, frame_velocity

if TYPE_CHECKING:
    import casadi

_BUILDERS: tuple[Callable[..., casadi.Function], ...] = (
    base_wrench,
    center_of_mass,
    center_of_mass_jacobian,
    centroidal_inertia,
    centroidal_map,
    centroidal_momentum,
    coriolis_matrix,
    forward_dynamics,
    forward_dynamics_derivatives,
    frame_acceleration,
    frame_jacobian,
    frame_jacobian_rate,
    frame_pose,
    frame_poses,
    frame_velocity,
    gravity_torque,
    inverse_dynamics,
    inverse_dynamics_derivatives,
    inverse_mass_matrix,
    kinetic_energy,
    mass_matrix,
    potential_energy,
    regressor,
    zero_moment_point,
)

QUANTITIES: MappingProxyType[str, Callable[..., casadi.Function]] = MappingProxyType(
    {builder.__name__: builder for builder in _BUILDERS}
)
"""Builder of every quantity of this package, by name."""


def function(pepper: PepperModel, quantity: str, *args: object, **keywords: object) -> casadi.Function:
    """Return the function of a quantity by its name.

    Args:
        pepper: The robot.
        quantity: Name of a quantity, see `QUANTITIES`.
        *args: Arguments of the builder after the robot, such as a frame.
        **keywords: Keyword arguments of the builder.

    Returns:
        Function that the builder returns.

    Raises:
        UnknownNameError: for an unknown quantity or frame.
    """
    try:
        builder = QUANTITIES[quantity]
    except (KeyError, TypeError):
        raise UnknownNameError("quantity", quantity, QUANTITIES) from None
    return builder(pepper, *args, **keywords)
