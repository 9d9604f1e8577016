"""Dynamics: torques, accelerations, mass, momentum, energy and balance."""

from pepper_kin.dynamics.center_of_mass import center_of_mass, total_mass, zero_moment_point
from pepper_kin.dynamics.energy import kinetic_energy, potential_energy
from pepper_kin.dynamics.forward import forward_dynamics
from pepper_kin.dynamics.inverse import gravity_torque, inverse_dynamics
from pepper_kin.dynamics.mass import mass_matrix
from pepper_kin.dynamics.newton_euler import newton_euler

__all__ = [
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
