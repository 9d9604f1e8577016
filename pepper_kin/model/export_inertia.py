"""Inertias of bodies that can exist, as physics engines require."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import read_only
from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model.kinematic_tree import ROUNDING, KinematicTree, TreeBody, impossible_inertia

TINY_MASS, TINY_INERTIA = 1e-12, 1e-9
"""Mass [kg] and principal moments [kg m^2] of a moving body without mass, which MuJoCo and SDF do not
allow."""
_SMALLEST = 1e-9
"""Minimum ratio of the smallest principal moment to the largest: a rod's is 0, and rounding may make it
negative."""


def loadable_bodies(tree: KinematicTree, format: str, balance: bool = False) -> dict[str, TreeBody]:
    """Return bodies whose principal moments A <= B <= C are above zero and keep A + B >= C, by link.

    An amount that makes an inertia possible is added to all three moments. Amounts up to 1e-9 kg m^2 (points
    and rods) or 2e-6 C (rounded digits) are added for every robot.

    Args:
        tree: Tree of the robot.
        format: Name of the export format, for messages.
        balance: Whether larger amounts are added too, with a warning for each link.

    Raises:
        ModelError: naming all links that need a larger amount, unless `balance` is set.

    Warns:
        ModelWarning: naming link and amount, with `balance`.
    """
    bodies, impossible = {}, []
    for link, body in tree.bodies.items():
        moments = np.linalg.eigvalsh(body.inertia)
        smallest = max(1e-12, _SMALLEST * float(moments[2]))
        excess = float(moments[2] - moments[0] - moments[1])
        missing = max(smallest - float(moments[0]), excess + smallest if excess > -smallest else 0.0, 0.0)
        if missing > max(TINY_INERTIA, 2.0 * ROUNDING * float(moments[2])):
            reason = f"link {link}: {impossible_inertia(moments)}"
            if balance:
                words = f"{format}: {reason}; {missing:.4g} kg m^2 is added to each of its moments"
                warnings.warn(words, ModelWarning, stacklevel=2)
            else:
                impossible.append(reason)
        inertia = body.inertia if missing == 0.0 else read_only(body.inertia + missing * np.eye(3))
        bodies[link] = replace(body, inertia=inertia)
    if impossible:
        advice = "balance_inertias=True adds to them what is missing, as MuJoCo's balanceinertia does"
        raise ModelError(f"{format} cannot hold inertias that no body has: {'; '.join(impossible)}; {advice}")
    return bodies
