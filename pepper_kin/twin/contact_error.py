"""Error of a contact problem that could not be solved."""

from __future__ import annotations

from pepper_kin.exceptions import PepperKinError


class ContactError(PepperKinError):
    """Error if the contacts of a world's step cannot be solved.

    Attributes:
        step: Index of the step, from 1.
        names: Names of the pairs in contact.
        cause: Cause of the failure.
    """

    def __init__(self, step: int, names: tuple[tuple[str, str], ...], cause: str) -> None:
        self.step, self.names, self.cause = step, names, cause
        touching = ", ".join(f"{a} on {b}" for a, b in dict.fromkeys(names)) or "nothing touches"
        super().__init__(f"world stopped at step {step}: {cause}; in contact: {touching}")
