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
    """Builds `pinocchio.Model` of a checked document once, and detects changes made to it since.

    Importing Pinocchio takes longer than reading the description, and many programs do without it.  A model
    that was never handed out to a user cannot have been changed, which spares comparing it.

    Args:
        document: The robot.
        joint_names: All moving joints, those that follow others included, in Pinocchio's order.
        changed: A model to use in place of that of the document, if there is one.

    Attributes:
        handed_out: Whether somebody outside may change the model.
    """

    def __init__(
        self, document: UrdfDocument, joint_names: tuple[str, ...], changed: Any | None = None
    ) -> None:
        self._document, self._joint_names = document, joint_names
        self._lock = threading.RLock()
        self._model = changed
        self._pristine: Any = None if changed is None else self._build()
        self.handed_out = changed is not None
        self._hashed_model: Any = None
        self._hashed_digest = ""
        self._text_digest = ""

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

    def hand_out(self) -> Any:
        """Return the model to somebody who may change it.

        Raises:
            ModelError: where Pinocchio refuses the document.
        """
        with self._lock:
            if self._pristine is None:
                self._pristine = self.get().copy()
                self.handed_out = True
        return self._model

    def changed(self) -> Any | None:
        """Return the model if it differs from what the document says."""
        return None if not self.handed_out or _same(self._model, self._pristine) else self._model

    def digest(self) -> str:
        """Return a hash of the document and of what has been changed in the model since it was built.

        A comparison in C++ (5 us) shows whether there is anything new to hash, and not even that is needed
        while the model has not been handed out.
        """
        if not self.handed_out or _same(self._model, self._pristine):
            if not self._text_digest:
                self._text_digest = _hash(self._document.text)
            return self._text_digest
        if self._hashed_model is None or not _same(self._model, self._hashed_model):
            with self._lock:
                assert self._model is not None
                snapshot = self._model.copy()
                self._hashed_digest = _hash(f"{self._document.text}\n{snapshot.saveToString()}")
                self._hashed_model = snapshot
        return self._hashed_digest

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
        ModelError: where its `pinocchio_model` was changed by hand.
    """
    if pepper.dynamics_model.changed() is not None:
        raise ModelError(
            f"robot {pepper.name!r}: its pinocchio_model was changed by hand, which its description does not "
            "hold; change limits and masses by with_limits() and with_masses(), placements in the URDF"
        )


def _same(first: Any, second: Any) -> bool:
    """Whether two models are equal; Pinocchio's comparison leaves out what is fixed to the world."""
    return bool(first == second and first.inertias[0] == second.inertias[0])


def _hash(text: str) -> str:
    import hashlib  # loads OpenSSL: not to be waited for where nothing is compiled

    return hashlib.sha256(text.encode()).hexdigest()
