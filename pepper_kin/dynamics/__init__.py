"""Dynamics: torques, accelerations, mass, momentum, energy and balance.

    inverse_dynamics, gravity_torque          torques of a motion, and at rest
    forward_dynamics                          accelerations caused by torques
    inverse_dynamics_derivatives, InverseDynamicsDerivatives
    forward_dynamics_derivatives, ForwardDynamicsDerivatives
    newton_euler                              independent implementation of inverse_dynamics
    external_torque, joint_friction           torques of forces at frames, and of friction
    mass_matrix, inverse_mass_matrix, coriolis_matrix, total_mass
    regressor, inertial_parameters            torques as a linear function of the inertial parameters
    kinetic_energy, potential_energy
    center_of_mass, center_of_mass_jacobian
    centroidal_momentum, centroidal_map, centroidal_inertia
    base_wrench, zero_moment_point            force of the floor on the robot, and the point where it acts
    tip_over_margin, WHEEL_CONTACTS           distance of that point from the edges of the wheels' triangle

Vectors q, v, a and tau have shape (..., n); spatial vectors are linear first.
"""

from typing import TYPE_CHECKING

from pepper_kin.dynamics.base_wrench import base_wrench
from pepper_kin.dynamics.center_of_mass import center_of_mass, center_of_mass_jacobian
from pepper_kin.dynamics.coriolis import coriolis_matrix
from pepper_kin.dynamics.derivatives import (
    ForwardDynamicsDerivatives,
    InverseDynamicsDerivatives,
    forward_dynamics_derivatives,
    inverse_dynamics_derivatives,
)
from pepper_kin.dynamics.energy import kinetic_energy, potential_energy
from pepper_kin.dynamics.external_force import external_torque
from pepper_kin.dynamics.forward import forward_dynamics
from pepper_kin.dynamics.friction import joint_friction
from pepper_kin.dynamics.inverse import gravity_torque, inverse_dynamics
from pepper_kin.dynamics.mass import inverse_mass_matrix, mass_matrix, total_mass
from pepper_kin.dynamics.momentum import centroidal_inertia, centroidal_map, centroidal_momentum
from pepper_kin.dynamics.newton_euler import newton_euler
from pepper_kin.dynamics.regressor import inertial_parameters, regressor
from pepper_kin.dynamics.tip_over import tip_over_margin
from pepper_kin.dynamics.zero_moment_point import zero_moment_point
from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.dynamics.pepper_wheels import WHEEL_CONTACTS

__all__ = [
    "WHEEL_CONTACTS",
    "ForwardDynamicsDerivatives",
    "InverseDynamicsDerivatives",
    "base_wrench",
    "center_of_mass",
    "center_of_mass_jacobian",
    "centroidal_inertia",
    "centroidal_map",
    "centroidal_momentum",
    "coriolis_matrix",
    "external_torque",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "gravity_torque",
    "inertial_parameters",
    "inverse_dynamics",
    "inverse_dynamics_derivatives",
    "inverse_mass_matrix",
    "joint_friction",
    "kinetic_energy",
    "mass_matrix",
    "newton_euler",
    "potential_energy",
    "regressor",
    "tip_over_margin",
    "total_mass",
    "zero_moment_point",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "pepper_wheels": "WHEEL_CONTACTS",
    },
)
