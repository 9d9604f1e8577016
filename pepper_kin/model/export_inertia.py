"""Inertias that other engines load: those of bodies that can exist."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import read_only
from pepper_kin.exceptions import ModelError, ModelWarning
from pepper_kin.model.kinematic_tree import ROUNDING, KinematicTree, TreeBody, impossible_inertia

TINY_MASS, TINY_INERTIA = 1e-12, 1e-9
"""Of a body that moves without mass, which MuJoCo and SDF do not allow [kg], [kg m^2]."""
_SMALLEST = 1e-9
"""Smallest principal moment, in proportion to the largest: a rod's is 0, which rounding may make negative."""


def loadable_bodies(tree: KinematicTree, format: str, balance: bool = False) -> dict[str, TreeBody]:
    """Return bodies whose principal moments A <= B <= C are above zero and keep A + B >= C, by link.

    What is missing is added to all three moments.  Up to 1e-9 kg m^2 (points and rods) or 1e-6 C (rounded
    digits) that is done for every robot.

    Args:
        tree: The robot's.
        format: Of the export, for messages.
        balance: Whether more than that is added, with a warning for each link.

    Raises:
        ModelError: naming all links that need more, unless `balance` is set.

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
