"""Base class of all statuses, `ResultStatus`: the result of a call, and advice."""

from __future__ import annotations

from enum import Enum

__all__ = ["ResultStatus"]


class ResultStatus(Enum):
    """How a call ended.

    A member is defined by its value, a word in lower case, and its advice, a sentence:

        OUT_OF_TIME = "out_of_time", "Allow more time."
    """

    _value_: str
    _advice: str

    def __new__(cls, value: str, advice: str) -> ResultStatus:
        """Return a member whose value is the word without the advice."""
        member = object.__new__(cls)
        member._value_ = value
        member._advice = advice
        return member

    @property
    def advice(self) -> str:
        """Advice to the caller in one sentence."""
        return self._advice
