"""Messages with random values in every field."""

import numpy as np

from pepper_kin.ros_messages.definitions import FIXED, STRING
from pepper_kin.ros_messages.messages import DTYPES

TEXTS = ("", "HeadYaw", "Hüfte \U0001f916", 'quote " and \\ and \n', "x" * 300)


def random_message(kind, rng):
    """Return a message of a class with random values; bounded sequences within their bounds."""
    return kind(**{field.attribute: _value(kind, field, rng) for field in kind.definition.fields})


def _value(kind, field, rng):
    if field.array is None:
        return _one(kind, field, rng)
    count = field.length if field.array == FIXED else int(rng.integers(0, min(field.length or 4, 4) + 1))
    return [_one(kind, field, rng) for _ in range(count)]


def _one(kind, field, rng):
    if field.nested:
        return random_message(kind.nested[field.name], rng)
    if field.base == STRING:
        text = TEXTS[rng.integers(len(TEXTS))]
        return text.encode()[: field.string_length].decode(errors="ignore") if field.string_length else text
    if field.base == "bool":
        return bool(rng.integers(2))
    dtype = np.dtype(DTYPES[field.base])
    if dtype.kind == "f":
        return float(dtype.type(rng.normal() * 10.0 ** rng.integers(-3, 4)))
    limits = np.iinfo(dtype)
    if field.name == "sec":  # mcap_ros2 reads seconds as unsigned
        return int(rng.integers(0, limits.max))
    return int(rng.integers(limits.min, limits.max, dtype=dtype, endpoint=True))
