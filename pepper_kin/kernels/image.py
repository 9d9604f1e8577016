"""Compiled function as a value: machine code and the data needed to call it."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any

from pepper_kin.kernels.instructions import Signature


@dataclass(frozen=True)
class KernelImage:
    """An object file with its description.

    Attributes:
        signature: Names and shapes of inputs and outputs.
        dtype: "float64" or "float32".
        lanes: Number of states in one vector.
        work_size: Size of the workspace that the block function needs, in numbers.
        flop_count: Number of arithmetic operations for one state; a sine counts as one.
        object_code: The object file.
    """

    signature: Signature
    dtype: str
    lanes: int
    work_size: int
    flop_count: int
    object_code: bytes

    def to_bytes(self) -> bytes:
        """Return the image as bytes: one line of JSON, then the object file."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "object_code"}
        return (
            json.dumps(fields | {"signature": dataclasses.asdict(self.signature)}).encode()
            + b"\n"
            + self.object_code
        )

    @classmethod
    def from_bytes(cls, data: bytes) -> KernelImage:
        """Return the image of bytes from `to_bytes`.

        Raises:
            ValueError, KeyError, TypeError: The bytes are not an image.
        """
        header, _, object_code = data.partition(b"\n")
        fields = json.loads(header)
        names: dict[str, Any] = {key: _as_tuples(value) for key, value in fields.pop("signature").items()}
        return cls(signature=Signature(**names), object_code=object_code, **fields)


def _as_tuples(value: object) -> object:
    """Return nested lists from JSON as tuples."""
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value
