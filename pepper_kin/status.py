"""The base of all statuses, `ResultStatus`: how a call ended, and what to do about it."""

from __future__ import annotations

from enum import Enum

__all__ = ["ResultStatus"]


class ResultStatus(Enum):
    """How a call ended.

    A member is written as its value, a word in lower case, and its advice, a sentence:

        OUT_OF_TIME = "out_of_time", "Allow more time."
    """

    _value_: str
    _advice: str

    def __new__(cls, value: str, advice: str) -> ResultStatus:
        """Return a member whose value is the word alone."""
        member = object.__new__(cls)
        member._value_ = value
        member._advice = advice
        return member

    @property
    def advice(self) -> str:
        """What the status means for the caller and what to try, in a sentence."""
        return self._advice
