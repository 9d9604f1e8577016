"""Dynamics: torques, accelerations, mass, momentum, energy and balance."""

from pepper_kin.dynamics.base_wrench import base_wrench
from pepper_kin.dynamics.center_of_mass import center_of_mass
from pepper_kin.dynamics.energy import kinetic_energy, potential_energy
from pepper_kin.dynamics.forward import forward_dynamics
from pepper_kin.dynamics.inverse import gravity_torque, inverse_dynamics
from pepper_kin.dynamics.mass import mass_matrix, total_mass
from pepper_kin.dynamics.newton_euler import newton_euler
from pepper_kin.dynamics.zero_moment_point import zero_moment_point

__all__ = [
    "base_wrench",
    "center_of_mass",
    "forward_dynamics",
    "gravity_torque",
    "inverse_dynamics",
    "kinetic_energy",
    "mass_matrix",
    "newton_euler",
    "potential_energy",
    "total_mass",
    "zero_moment_point",
]
