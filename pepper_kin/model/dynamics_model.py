"""Pinocchio's model of a robot, built at its first use."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.exceptions import ModelError
from pepper_kin.lazy_names import lazy_module
from pepper_kin.model.urdf_document import UrdfDocument

if TYPE_CHECKING:
    from pepper_kin.model.pepper_model import PepperModel

plain_urdf = lazy_module("pepper_kin.model.plain_urdf")

MOST_COMPUTED = 300
"""Maximum number of moving joints that Pinocchio computes with: its working memory then takes 0.9 GB."""


def working_memory(model: Any) -> Any:
    """Return a `pinocchio.Data`, which holds four arrays of n^3 numbers (second derivatives of torques).

    Raises:
        ModelError: for more than MOST_COMPUTED moving joints, with the memory they would take.
    """
    if model.nv > MOST_COMPUTED:
        size = 32e-9 * model.nv**3
        raise ModelError(
            f"robot {model.name!r} has {model.nv} moving joints, for which Pinocchio's working memory takes "
            f"{size:.3g} GB; this is computed for at most {MOST_COMPUTED}"
        )
    return model.createData()


class DynamicsModel:
    """`pinocchio.Model` of a checked document, built once, or a given model in its place.

    Importing Pinocchio takes longer than reading the description, and many programs do without it.

    Args:
        document: The robot.
        joint_names: All moving joints, following joints included, in Pinocchio's order.
        changed: Model to use instead of the document's, which must not be changed afterwards; or None.
    """

    def __init__(
        self, document: UrdfDocument, joint_names: tuple[str, ...], changed: Any | None = None
    ) -> None:
        self._document, self._joint_names = document, joint_names
        self._lock = threading.RLock()
        self._model = self._changed = changed
        self._digest = ""

    def get(self) -> Any:
        """Return the model, which all callers share and must not change.

        Raises:
            ModelError: if Pinocchio refuses the document.
        """
        if self._model is None:
            with self._lock:
                if self._model is None:
                    self._model = self._build()
        return self._model

    def changed(self) -> Any | None:
        """Return the model that replaces the document's, or None."""
        return self._changed

    def digest(self) -> str:
        """Return a hash of the document and of the model that replaces its own, if any."""
        if not self._digest:
            own = "" if self._changed is None else f"\n{self._changed.saveToString()}"
            self._digest = _hash(f"{self._document.text}{own}")
        return self._digest

    def _build(self) -> Any:
        """Build Pinocchio's model of the document and check the order of its joints."""
        import pinocchio

        name = self._document.name
        try:
            model = pinocchio.buildModelFromXML(plain_urdf.plain_urdf(self._document))
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"URDF: Pinocchio refuses robot {name!r}: {error}") from error
        if tuple(model.names)[1:] != self._joint_names:
            raise ModelError(f"URDF: Pinocchio orders the joints of robot {name!r} in another way")
        joints = {joint.name: joint for joint in self._document.joints}
        model.lowerPositionLimit = np.array([joints[joint].lower for joint in self._joint_names])
        model.upperPositionLimit = np.array([joints[joint].upper for joint in self._joint_names])
        return model


def described(pepper: PepperModel) -> None:
    """Refuse a robot whose Pinocchio model differs from its description.

    Raises:
        ModelError: for a robot made by `with_pinocchio_model`.
    """
    if pepper.dynamics_model.changed() is not None:
        raise ModelError(
            f"robot {pepper.name!r}: it was given another pinocchio_model, which its description does not "
            "hold; change limits and masses by with_limits() and with_masses(), placements in the URDF"
        )


def _hash(text: str) -> str:
    import hashlib  # loads OpenSSL, which is slow: imported only if a hash is needed

    return hashlib.sha256(text.encode()).hexdigest()
