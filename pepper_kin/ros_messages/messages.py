"""Classes of messages, created from their definitions.

    JointState = message_type("sensor_msgs/msg/JointState")
    message = JointState(name=["HeadYaw"], position=[0.3])

Numbers and strings are Python's; arrays of numbers are NumPy arrays, which accept lists of numbers, bytes and
arrays of any shape (flattened row by row); sequences of strings and of messages are lists.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.ros_messages.definitions import (
    ACTION_PARTS,
    BOUNDED,
    FIXED,
    PRIMITIVES,
    SERVICE_PARTS,
    STRING,
    TAKEN_NAMES,
    UNBOUNDED,
    Definition,
    Field,
    definition,
    full_name,
    interface_names,
    message_names,
)
from pepper_kin.ros_messages.errors import MessageError

DTYPES = {base: np.dtype(code) for base, (code, _) in PRIMITIVES.items()}
"""Primitive type -> dtype of its arrays."""


def _empty(dtype: np.dtype[Any]) -> NDArray[Any]:
    array = np.empty(0, dtype)
    array.flags.writeable = False
    return array


EMPTY = {base: _empty(dtype) for base, dtype in DTYPES.items()}
"""Primitive type -> its empty array, read-only."""

_KINDS = {"b": "b", "i": "iu", "u": "iu", "f": "fiu"}
_WORDS = {"b": "bools", "i": "whole numbers", "u": "whole numbers", "f": "numbers"}


class Message:
    """Base class of all messages; `message_type` returns the classes.

    Messages of the same type with equal fields are equal (NaN equals nothing).

    Attributes:
        definition: Fields and constants of the type.
        type_name: Full name of the type.
        nested: Name of a message-typed field -> its class.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # messages are mutable
    definition: ClassVar[Definition]
    type_name: ClassVar[str]
    nested: ClassVar[dict[str, type[Message]]]

    if TYPE_CHECKING:

        def __init__(self, **fields: Any) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

        def __setattr__(self, name: str, value: Any) -> None: ...

    def __eq__(self, other: object) -> bool:
        """Compare by type and fields."""
        if not isinstance(other, Message) or other.type_name != self.type_name:
            return NotImplemented
        return all(
            _equal(getattr(self, f.attribute), getattr(other, f.attribute)) for f in self.definition.fields
        )

    def __repr__(self) -> str:
        """Return the constructor's call, with long arrays shortened."""
        with np.printoptions(threshold=20, edgeitems=3):
            values = ", ".join(
                f"{f.attribute}={getattr(self, f.attribute)!r}" for f in self.definition.fields
            )
        return f"{type(self).__name__}({values})"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the name of the type, its definitions and the fields."""
        values = {f.attribute: getattr(self, f.attribute) for f in self.definition.fields}
        return _restored, (self.type_name, _definitions_of(type(self)), values)

    def to_dict(self) -> dict[str, Any]:
        """Convert to JSON values; see `pepper_kin.ros_messages.dictionaries`."""
        from pepper_kin.ros_messages.dictionaries import to_dict

        return to_dict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Convert JSON values to a message; see `pepper_kin.ros_messages.dictionaries`."""
        from pepper_kin.ros_messages.dictionaries import from_dict

        return from_dict(cls, values)


class ServiceType(NamedTuple):
    """Message classes of a service."""

    request: type[Message]
    response: type[Message]


class ActionType(NamedTuple):
    """Message classes of an action."""

    goal: type[Message]
    result: type[Message]
    feedback: type[Message]


@cache
def message_type(type_name: str) -> type[Message]:
    """Return the class of a message type.

    Args:
        type_name: Full or short name: `sensor_msgs/msg/JointState` or `sensor_msgs/JointState`; parts of
            services and actions are messages, too: `std_srvs/srv/SetBool_Request`.

    Raises:
        UnknownNameError: for a type that the package does not have.
    """
    found = definition(type_name)
    if found.type_name != type_name:
        return message_type(found.type_name)
    return make_class(found, {f.name: message_type(f.base) for f in found.fields if f.nested})


@cache
def service_type(type_name: str) -> ServiceType:
    """Return the classes of a service, such as `std_srvs/srv/Trigger`; UnknownNameError if unknown."""
    name = full_name(type_name, "srv")
    if name not in interface_names("srv"):
        raise UnknownNameError("service type", type_name, interface_names("srv"))
    return ServiceType(*(message_type(name + part) for part in SERVICE_PARTS))


@cache
def action_type(type_name: str) -> ActionType:
    """Return the classes of an action, such as `control_msgs/action/FollowJointTrajectory`.

    Raises UnknownNameError for an unknown action.
    """
    name = full_name(type_name, "action")
    if name not in interface_names("action"):
        raise UnknownNameError("action type", type_name, interface_names("action"))
    return ActionType(*(message_type(name + part) for part in ACTION_PARTS))


def make_class(found: Definition, nested: dict[str, type[Message]]) -> type[Message]:
    """Create the class of a definition.

    Args:
        found: Definition of the message.
        nested: Name of a message-typed field -> its class.
    """
    names = tuple(field.attribute for field in found.fields)
    body: dict[str, Any] = {
        "__slots__": names,
        "__module__": __name__,
        "__doc__": f"Message `{found.type_name}`: {', '.join(names) or 'without fields'}.",
        "definition": found,
        "type_name": found.type_name,
        "nested": nested,
        "__init__": _constructor(found, nested),
    }
    constants = {n + "_" * (n in TAKEN_NAMES): value for n, value in found.constants.items()}
    name = found.type_name.rsplit("/", 1)[-1]
    return type(name, (Message,), constants | body)


def _constructor(found: Definition, nested: dict[str, type[Message]]) -> Any:
    """Generate `__init__` with a keyword for each field; a loop would take three times as long."""
    parameters, lines = [], []
    space: dict[str, Any] = {"_as_array": as_array, "_type": found.type_name}
    for i, field in enumerate(found.fields):
        name = field.attribute
        space[f"_field{i}"] = field
        scalar = field.array is None and not field.nested
        if scalar:
            space[f"_default{i}"] = _scalar_default(field)
            parameters.append(f"{name}=_default{i}")
            lines.append(f"self.{name} = {name}")
            continue
        parameters.append(f"{name}=None")
        space[f"_default{i}"] = _default_factory(field, nested.get(field.name))
        value = name
        if field.array is not None:
            numbers = field.base in PRIMITIVES
            value = (
                f"_as_array({name}, _field{i}, _type)" if numbers else f"_as_list({name}, _field{i}, _type)"
            )
        lines.append(f"self.{name} = _default{i}() if {name} is None else {value}")
    space["_as_list"] = _as_list
    signature = f"self, *, {', '.join(parameters)}" if parameters else "self"
    exec(f"def __init__({signature}):\n    " + "\n    ".join(lines or ["pass"]), space)
    return space["__init__"]


def _scalar_default(field: Field) -> Any:
    if field.default is not None:
        return float(field.default) if field.base.startswith("float") else field.default
    return {STRING: "", "bool": False, "float32": 0.0, "float64": 0.0}.get(field.base, 0)


def _default_factory(field: Field, kind: type[Message] | None) -> Any:
    """Return a function that creates the default of an array, a list or a message."""
    if field.array is None:
        return kind
    if kind is not None:
        return (lambda: [kind() for _ in range(field.length)]) if field.array == FIXED else list
    if field.base == STRING:
        values = list(field.default or ([""] * field.length if field.array == FIXED else []))
        return values.copy
    if field.default is not None:
        return np.array(field.default, DTYPES[field.base]).copy
    if field.array == FIXED:
        return np.zeros(field.length, DTYPES[field.base]).copy
    empty = EMPTY[field.base]
    return lambda: empty


def as_array(value: ArrayLike, field: Field, type_name: str) -> NDArray[Any]:
    """Convert numbers to the array of a field, shape (k,): a copy, except of read-only arrays.

    Args:
        value: Numbers or bytes, of any shape.
        field: Field of the array.
        type_name: Name of the message type, for errors.

    Raises:
        InvalidValueError: for invalid values or a wrong number of them, with the field's name.
    """
    dtype = DTYPES[field.base]
    if isinstance(value, np.ndarray) and value.dtype == dtype:
        array = value.ravel() if value.ndim != 1 else value
        if value.flags.writeable or not array.flags.c_contiguous:
            array = array.copy()
    elif isinstance(value, bytes | bytearray | memoryview) and dtype.itemsize == 1:
        array = np.frombuffer(bytes(value), dtype)
    else:
        array = _converted(value, field, type_name, dtype)
    if field.array != UNBOUNDED:
        _check_length(len(array), field, type_name)
    return array


def _converted(value: Any, field: Field, type_name: str, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Convert numbers to a flat array of a type, without rounding or overflow of integers."""
    try:
        raw = np.asarray(value)
        mixed = dtype == np.uint64 and raw.dtype.kind == "f" and isinstance(value, list | tuple)
        if mixed and all(type(x) is int and 0 <= x < 2**64 for x in value):  # NumPy converts them to floats
            raw = np.array(value, dtype)
        if raw.size and raw.dtype.kind not in _KINDS[dtype.kind]:
            raise TypeError
        with np.errstate(over="ignore"):
            array = raw.astype(dtype).ravel()
        if dtype.kind in "iu" and raw.size and not np.array_equal(array, raw.ravel()):
            raise OverflowError
    except (TypeError, ValueError, OverflowError):
        words = f"{_WORDS[dtype.kind]} that {field.base} can hold"
        raise InvalidValueError(f"{type_name}.{field.name}", value, words) from None
    return array


def _as_list(value: Iterable[Any], field: Field, type_name: str) -> list[Any]:
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        values = list(value)
    except TypeError:
        what = "a list of messages" if field.nested else "a list of strings"
        raise InvalidValueError(f"{type_name}.{field.name}", value, what) from None
    if field.array != UNBOUNDED:
        _check_length(len(values), field, type_name)
    return values


def _check_length(length: int, field: Field, type_name: str) -> None:
    wrong = length != field.length if field.array == FIXED else length > field.length
    if field.array in (FIXED, BOUNDED) and wrong:
        words = f"{'exactly' if field.array == FIXED else 'at most'} {field.length}"
        raise InvalidValueError(f"{type_name}.{field.name}", f"{length} elements", words)


def check_message(message: Message, kind: type[Message], where: str = "") -> None:
    """Check that all values of a message fit their types.

    Args:
        message: Message to check.
        kind: Expected class of the message.
        where: Path of the fields that lead to the message, for errors.

    Raises:
        InvalidValueError: for the first value that does not fit, with the field's path.
    """
    where = where or kind.type_name
    if not isinstance(message, Message) or message.type_name != kind.type_name:
        got = message.type_name if isinstance(message, Message) else message
        raise InvalidValueError(where, got, f"a message {kind.type_name}")
    for field in kind.definition.fields:
        value: Any = getattr(message, field.attribute, None)
        path = f"{where}.{field.name}"
        if field.array is None:
            _check_value(value, field, kind, path)
        elif field.base in PRIMITIVES:
            as_array(value, field, where)
        else:
            for i, element in enumerate(_as_list(value, field, where)):
                _check_value(element, field, kind, f"{path}[{i}]")


def _check_value(value: Any, field: Field, kind: type[Message], path: str) -> None:
    """Check a value of a field that is no array of numbers."""
    if field.nested:
        check_message(value, kind.nested[field.name], path)
    elif field.base == STRING:
        if not isinstance(value, str):
            raise InvalidValueError(path, value, "a string")
        if "\0" in value or any("\ud800" <= c <= "\udfff" for c in value):
            raise InvalidValueError(path, value, "a string without NUL and half surrogate pairs")
        if field.string_length and len(value.encode()) > field.string_length:
            raise InvalidValueError(path, value, f"at most {field.string_length} bytes of UTF-8")
    else:
        check_number(value, field.base, path)


def check_number(value: Any, base: str, path: str) -> None:
    """Check that a value fits a primitive type.

    Args:
        value: Value to check.
        base: Primitive type.
        path: Path of fields, for errors.

    Raises:
        InvalidValueError: if it does not fit, with the path.
    """
    kind, whole = DTYPES[base].kind, isinstance(value, int | np.integer)
    if kind == "b" and not isinstance(value, bool | np.bool_):
        raise InvalidValueError(path, value, "True or False")
    if kind == "f" and not (isinstance(value, float | np.floating) or whole):
        raise InvalidValueError(path, value, "a number")
    if kind in "iu":
        limits = np.iinfo(DTYPES[base])
        if not whole or not limits.min <= int(value) <= limits.max:
            raise InvalidValueError(path, value, f"a whole number from {limits.min} to {limits.max}")


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    return bool(a == b)


def library_type(type_name: str, library: dict[str, Definition]) -> type[Message]:
    """Return the class of a type of another library; the package's class if the definitions agree.

    Args:
        type_name: Full name.
        library: Full name -> definition, of the type and all types within it.

    Raises:
        UnknownNameError: for a type that is not in the library.
        MessageError: for a type that contains itself.
    """
    classes: dict[str, type[Message]] = {}

    def find(name: str, outer: tuple[str, ...]) -> type[Message]:
        if name in outer:
            raise MessageError(type_name, f"definition of {name} contains itself")
        if name not in library:
            raise UnknownNameError("message type", name, library)
        if name not in classes:
            found = library[name]
            nested = {f.name: find(f.base, (*outer, name)) for f in found.fields if f.nested}
            own = message_type(name) if name in message_names() else None
            agrees = own is not None and own.definition.fields == found.fields and own.nested == nested
            classes[name] = own if own is not None and agrees else make_class(found, nested)
        return classes[name]

    return find(type_name, ())


def _definitions_of(kind: type[Message]) -> dict[str, Definition]:
    found = {kind.type_name: kind.definition}
    for inner in kind.nested.values():
        found |= _definitions_of(inner)
    return found


def _restored(type_name: str, library: dict[str, Definition], values: dict[str, Any]) -> Message:
    return library_type(type_name, library)(**values)
