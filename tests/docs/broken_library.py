"""Libraries whose functions raise; as a plugin of pytest: `BROKEN_LIBRARY=coal BROKEN_FOR=tests/fuzz`.

They raise where a file whose path contains `BROKEN_FOR` calls them: what is examined may call the same
library.
"""

import functools
import importlib
import os
import sys
from operator import attrgetter
from types import ModuleType
from typing import Any

FUNCTIONS = {
    "Pinocchio": (
        "pinocchio",
        "rnea aba crba computeABADerivatives computeFrameJacobian computeGeneralizedGravity "
        "computeRNEADerivatives framesForwardKinematics getFrameJacobianTimeVariation jacobianCenterOfMass",
    ),
    "coal": ("pinocchio", "computeCollisions computeDistance"),
    "CasADi": ("casadi", "Function.__call__"),
    "MuJoCo": ("mujoco", "mj_applyFT mj_forward mj_mulM mj_step"),
    "toppra": ("toppra.algorithm", "TOPPRA.compute_parameterization"),
    "placo": ("placo", "KinematicsSolver.solve"),
    "proxsuite": ("proxsuite", "proxqp.dense.QP.solve"),
}
"""Library -> a module, and what computes in it; coal's loops over pairs are called by way of Pinocchio."""


class LibraryCalled(BaseException):
    """Says which function was called; nothing that goes on after an error catches it."""


def places_of(library: str, path: str) -> list[tuple[Any, str]]:
    """Return where a function is looked up: in its module or class, and in what stands for that module."""
    name, (above, _, function) = FUNCTIONS[library][0], path.rpartition(".")
    later = [
        value
        for module in list(sys.modules.values())
        if getattr(module, "__name__", "").startswith("pepper_kin.")
        for value in vars(module).values()
        if isinstance(value, ModuleType) and value.__name__ == name
    ]
    owners = {id(owner): owner for owner in (*later, importlib.import_module(name))}
    return [(attrgetter(above)(owner) if above else owner, function) for owner in owners.values()]


def raising(library: str, path: str, callers: str = "") -> Any:
    """Return a function that raises where a file whose path contains `callers` calls it."""
    function = attrgetter(path)(importlib.import_module(FUNCTIONS[library][0]))

    @functools.wraps(function, assigned=())
    def call(*arguments: Any, **options: Any) -> Any:
        if callers in sys._getframe(1).f_code.co_filename:
            raise LibraryCalled(f"{library}: {path} was called")
        return function(*arguments, **options)

    return call


if "BROKEN_LIBRARY" in os.environ:
    library = os.environ["BROKEN_LIBRARY"]
    for path in FUNCTIONS[library][1].split():
        broken = raising(library, path, os.environ["BROKEN_FOR"])
        for owner, name in places_of(library, path):
            setattr(owner, name, broken)
