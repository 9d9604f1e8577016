"""Barrier term of balance on the wheels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin import symbolic
from pepper_kin.batch import kernel
from pepper_kin.dynamics import total_mass
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest
from pepper_kin.motion.optimization.carried import carrying_kernels
from pepper_kin.motion.optimization.kernel_term import KernelTerm
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.planners.optimization import BarrierBound
from pepper_kin.trajectory.balance import moment_matrix, support_polygon

if TYPE_CHECKING:
    import casadi


INFLUENCE = 0.03
"""Distance beyond the margin above which the zero-moment point's edge distance has no effect [m]."""
_GRAVITY = 9.81  # [m/s^2]
SOURCES = ("pepper_kin.symbolic", "pepper_kin.model", "pepper_kin.motion.optimization.balance_term")
"""Modules on which the kernel depends."""


class BalanceTerm(KernelTerm):
    """Slack (i . (-n_y, n_x) - (i . p + margin) f_z) / (weight INFLUENCE) of each edge of the triangle.

    (f, n) is the wrench of the floor, p a vertex of an edge of the wheels' triangle, i the unit vector that
    points inward; see `trajectory.balance.edge_moments`.  The slack is linear in the wrench, which CasADi
    differentiates.

    Args:
        moving: The joints that move.
        margin: Distance that the zero-moment point keeps from the edges [m].
        per_interval: Samples in each interval of the spline.
        loads: Carried loads.

    Raises:
        InvalidValueError: for a robot without Pepper's wheels, or with a base that moves.
    """

    def __init__(self, moving: Moving, margin: float, per_interval: int, loads: Loads = ()) -> None:
        pepper = moving.pepper
        polygon = support_polygon(pepper)
        if polygon is None or "BaseX" in pepper.joint_names:
            raise InvalidValueError(
                "balance", margin, "None for a robot without wheels or with a moving base"
            )
        shares = moment_matrix(polygon, margin).T / (_GRAVITY * total_mass(pepper) * INFLUENCE)
        constants = None
        if loads:
            kernels, constants = carrying_kernels(pepper, "base_wrench", loads)
        else:
            kernels = kernel(pepper, "base_wrench"), _wrench_derivatives(pepper)
        super().__init__(moving, kernels, shares, per_interval, BarrierBound.ABOVE_ZERO, constants)


@kept_for_robot(most=1)
def _wrench_derivatives(pepper: PepperModel) -> Kernel:
    """Return the kernel (q, v, a) -> Jacobians of the floor's wrench by q, v and a, shape (6, n) each."""

    def build() -> casadi.Function:
        import casadi

        state = [casadi.SX.sym(name, pepper.n) for name in ("q", "v", "a")]
        wrench = symbolic.base_wrench(pepper)(*state)
        slopes = [casadi.cse(casadi.jacobian(wrench, part)) for part in state]
        return casadi.Function("base_wrench_derivatives", state, slopes)

    key = f"base wrench derivatives of {robot_digest(pepper)} by {source_digest(*SOURCES)}"
    return compile_function(build, key=key)
