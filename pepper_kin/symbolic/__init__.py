"""CasADi `SX` functions of a robot's kinematics and dynamics, for optimization and for compilation.

    from pepper_kin import load_pepper, symbolic

    pepper = load_pepper()
    dynamics = symbolic.forward_dynamics(pepper)         # casadi.Function (q, v, tau) -> a
    hand = symbolic.frame_pose(pepper, "LArm_effector")  # q -> 4 x 4

Each builder takes a robot and names, and returns a `casadi.Function` of column vectors, built once for each
robot. The model's constants are folded in, and entries that are always zero are structural zeros.

    frame_pose, frame_poses, frame_velocity, frame_acceleration, frame_jacobian, frame_jacobian_rate
    inverse_dynamics, gravity_torque, forward_dynamics
    inverse_dynamics_derivatives, forward_dynamics_derivatives
    mass_matrix, inverse_mass_matrix, coriolis_matrix, regressor, kinetic_energy, potential_energy
    center_of_mass, center_of_mass_jacobian, centroidal_momentum, centroidal_map, centroidal_inertia
    base_wrench, zero_moment_point
    function, QUANTITIES                      any quantity by name

The builders are named after the functions of `kinematics` and `dynamics` that compute the same quantities.
"""

from pepper_kin.call_errors import name_options
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
from pepper_kin.symbolic.registry import QUANTITIES, function
from pepper_kin.symbolic.regressor import regressor
from pepper_kin.symbolic.velocities import frame_acceleration, frame_velocity

__all__ = [
    "QUANTITIES",
    "base_wrench",
    "center_of_mass",
    "center_of_mass_jacobian",
    "centroidal_inertia",
    "centroidal_map",
    "centroidal_momentum",
    "coriolis_matrix",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "frame_acceleration",
    "frame_jacobian",
    "frame_jacobian_rate",
    "frame_pose",
    "frame_poses",
    "frame_velocity",
    "function",
    "gravity_torque",
    "inverse_dynamics",
    "inverse_dynamics_derivatives",
    "inverse_mass_matrix",
    "kinetic_energy",
    "mass_matrix",
    "potential_energy",
    "regressor",
    "zero_moment_point",
]

name_options(__name__)
