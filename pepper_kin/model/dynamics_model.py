"""Pinocchio's model of a robot, built when it is first asked for."""

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
"""Moving joints that Pinocchio can compute with: for so many its working memory takes 0.9 GB."""


def working_memory(model: Any) -> Any:
    """Return a `pinocchio.Data`, which holds four arrays of n^3 numbers (second derivatives of torques).

    Raises:
        ModelError: for more than MOST_COMPUTED moving joints, naming what they would take.
    """
    if model.nv > MOST_COMPUTED:
        size = 32e-9 * model.nv**3
        raise ModelError(
            f"robot {model.name!r} has {model.nv} moving joints, for which Pinocchio's working memory takes "
            f"{size:.3g} GB; this is computed for at most {MOST_COMPUTED}"
        )
    return model.createData()


class DynamicsModel:
    """Builds `pinocchio.Model` of a checked document once, unless another one takes its place.

    Importing Pinocchio takes longer than reading the description, and many programs do without it.

    Args:
        document: The robot.
        joint_names: All moving joints, those that follow others included, in Pinocchio's order.
        changed: A model to use in place of that of the document, if there is one, which nobody changes.
    """

    def __init__(
        self, document: UrdfDocument, joint_names: tuple[str, ...], changed: Any | None = None
    ) -> None:
        self._document, self._joint_names = document, joint_names
        self._lock = threading.RLock()
        self._model = self._changed = changed
        self._digest = ""

    def get(self) -> Any:
        """Return the model to read it; all callers share it.

        Raises:
            ModelError: where Pinocchio refuses the document.
        """
        if self._model is None:
            with self._lock:
                if self._model is None:
                    self._model = self._build()
        return self._model

    def changed(self) -> Any | None:
        """Return the model that takes the place of that of the document, or None."""
        return self._changed

    def digest(self) -> str:
        """Return a hash of the document, and of the model that takes its place."""
        if not self._digest:
            own = "" if self._changed is None else f"\n{self._changed.saveToString()}"
            self._digest = _hash(f"{self._document.text}{own}")
        return self._digest

    def _build(self) -> Any:
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
    """Refuse a robot whose description does not hold all there is to know of it.

    Raises:
        ModelError: where it was given another model by `with_pinocchio_model`.
    """
    if pepper.dynamics_model.changed() is not None:
        raise ModelError(
            f"robot {pepper.name!r}: it was given another pinocchio_model, which its description does not "
            "hold; change limits and masses by with_limits() and with_masses(), placements in the URDF"
        )


def _hash(text: str) -> str:
    import hashlib  # loads OpenSSL: not to be waited for where nothing is compiled

    return hashlib.sha256(text.encode()).hexdigest()
