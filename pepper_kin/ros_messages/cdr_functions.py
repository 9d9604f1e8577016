"""Generation of functions that encode and decode one message type, as Python source.

The generator tracks the offset of the next byte modulo M in {1, 2, 4, 8}: numbers whose alignment
follows from it are packed by one `struct.Struct`; others are aligned at run time.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from pepper_kin.ros_messages.definitions import BOUNDED, FIXED, PRIMITIVES, STRING, Definition, Field
from pepper_kin.ros_messages.messages import DTYPES, EMPTY, Message, as_array

_ZEROS = tuple(bytes(n) for n in range(8))


class _Source:
    """Source lines of a function, its constants, and the known part of the offset.

    Args:
        order: "<" for little-endian numbers, ">" for big-endian ones, as in `struct`.
    """

    def __init__(self, order: str = "<") -> None:
        self.order = order
        self.lines: list[str] = []
        self.space: dict[str, Any] = {
            "_zeros": _ZEROS,
            "_raise": _raise,
            "_nul": _refuse_nul,
            "_new": object.__new__,
            "_frombuffer": np.frombuffer,
            "_native": _native,
        }
        self.modulus, self.offset = 1, 0
        self.pending: list[tuple[str, str, int]] = []  # expression, code, size
        self._count = 0

    def name(self, prefix: str) -> str:
        """Return a new name of a variable."""
        self._count += 1
        return f"_{prefix}{self._count}"

    def constant(self, prefix: str, value: Any) -> str:
        """Add a constant; return its name."""
        name = self.name(prefix)
        self.space[name] = value
        return name

    def add(self, *lines: str) -> None:
        """Append source lines."""
        self.lines += lines

    def known(self, modulus: int, offset: int = 0) -> None:
        """Set the known part of the offset: modulus and remainder."""
        self.modulus, self.offset = modulus, offset % modulus

    def groups(self) -> list[tuple[int, list[tuple[str, str]], struct.Struct]]:
        """Return the pending numbers in groups of alignment at run time (1 for none), members and layout."""
        found: list[tuple[int, list[tuple[str, str]], str]] = []
        for expression, code, size in self.pending:
            if size > self.modulus:
                found.append((size, [], ""))
                self.known(size)
            elif not found:
                found.append((1, [], ""))
            padding = -self.offset % size
            align, members, layout = found[-1]
            found[-1] = (align, [*members, (expression, code)], layout + "x" * padding + code)
            self.known(self.modulus, self.offset + padding + size)
        self.pending = []
        return [(align, members, struct.Struct(self.order + layout)) for align, members, layout in found]

    def function(self, head: str, filename: str) -> Any:
        """Compile the source, and return the function."""
        source = head + "\n    " + "\n    ".join(self.lines)
        exec(compile(source, filename, "exec"), self.space)
        return self.space["_function"]


def encoder(kind: type[Message]) -> Any:
    """Return `function(message, out)`, which appends to a bytearray that starts with the encapsulation."""
    return _cached(kind, 8, "<", _encoders, _make_encoder)


def decoder(kind: type[Message], order: str = "<") -> Any:
    """Return `function(view, position, size)`, which returns a message and its end position.

    Args:
        kind: Class of the message.
        order: "<" for little-endian numbers, ">" for big-endian ones.
    """
    return _cached(kind, 8, order, _decoders, _make_decoder)


_Cache = dict[tuple[type[Message], int, str], Any]
_encoders: _Cache = {}
_decoders: _Cache = {}


def _cached(kind: type[Message], modulus: int, order: str, cache: _Cache, make: Any) -> Any:
    function = cache.get((kind, modulus, order))
    if function is None:
        function = cache[kind, modulus, order] = make(kind, modulus, order)
    return function


def least_size(found: type[Message]) -> int:
    """Return the minimum size of a message [bytes], which bounds the length of a sequence."""
    size = 0
    for field in found.definition.fields:
        one = 4
        if field.array in (None, FIXED):
            one = PRIMITIVES[field.base][1] if field.base in PRIMITIVES else 4
            one = least_size(found.nested[field.name]) if field.nested else one
            one *= field.length or 1
        size += one
    return max(1, size)


def _make_encoder(kind: type[Message], modulus: int, order: str) -> Any:
    source = _Source(order)
    source.known(modulus)
    _encode_fields(source, kind, "m")
    _flush_out(source)
    return source.function("def _function(m, out):", f"<encoder of {kind.type_name}>")


def _encode_fields(source: _Source, kind: type[Message], owner: str) -> None:
    """Add the lines that encode the fields of a message; `owner` is its expression."""
    if not kind.definition.fields:
        source.pending.append(("0", "B", 1))
    for field in kind.definition.fields:
        expression = f"{owner}.{field.attribute}"
        if field.array is not None:
            _encode_array(source, kind, field, expression)
        elif field.nested:
            inner = source.name("v")
            source.add(f"{inner} = {expression}")
            _encode_fields(source, kind.nested[field.name], inner)
        elif field.base == STRING:
            text = source.name("s")
            source.add(f"{text} = {expression}.encode()", f"if 0 in {text}: _nul()")
            if field.string_length:
                source.add(f"if len({text}) > {field.string_length}: _raise('string of', len({text}))")
            source.pending.append((f"len({text}) + 1", "I", 4))
            _flush_out(source)
            source.add(f"out += {text}", "out += b'\\0'")
            source.known(1)
        else:
            source.pending.append((expression, *PRIMITIVES[field.base]))


def _flush_out(source: _Source) -> None:
    """Add the lines that pack the pending numbers."""
    for align, members, layout in source.groups():
        if align > 1:
            source.add(f"out += _zeros[(4 - len(out)) & {align - 1}]")
        if members:
            pack = source.constant("pack", layout.pack)
            source.add(f"out += {pack}({', '.join(expression for expression, _ in members)})")


def _encode_array(source: _Source, kind: type[Message], field: Field, expression: str) -> None:
    """Add the lines that encode an array or a sequence."""
    value = source.name("a")
    source.add(f"{value} = {expression}")
    if field.base in PRIMITIVES:
        convert = source.constant("convert", _array_converter(kind.definition, field))
        dtype = source.constant("dtype", DTYPES[field.base])
        array_type = source.constant("ndarray", np.ndarray)
        test = f"type({value}) is not {array_type} or {value}.dtype != {dtype} or {value}.ndim != 1"
        test += f" or not {value}.flags.c_contiguous"
        source.add(f"if {test}: {value} = {convert}({value})")
    if field.array == FIXED:
        source.add(f"if len({value}) != {field.length}: _raise('array of', len({value}))")
    else:
        if field.array == BOUNDED:
            source.add(f"if len({value}) > {field.length}: _raise('sequence of', len({value}))")
        source.pending.append((f"len({value})", "I", 4))
    _flush_out(source)
    if field.base in PRIMITIVES:
        size = PRIMITIVES[field.base][1]
        source.add(f"if len({value}):")
        if size > source.modulus or source.offset % size:
            source.add(f"    out += _zeros[(4 - len(out)) & {size - 1}]")
        source.add(f"    out += {value}.data")
        source.known(size if field.array == FIXED else min(size, 4))
        return
    element = source.name("e")
    source.add(f"for {element} in {value}:")
    if field.nested:
        encode = source.constant("encode", _cached(kind.nested[field.name], 1, "<", _encoders, _make_encoder))
        source.add(f"    {encode}({element}, out)")
    else:
        pack = source.constant("pack", struct.Struct("<I").pack)
        source.add(
            f"    {element} = {element}.encode()",
            f"    if 0 in {element}: _nul()",
            "    out += _zeros[-len(out) & 3]",
            f"    out += {pack}(len({element}) + 1)",
            f"    out += {element}",
            "    out += b'\\0'",
        )
        if field.string_length:
            source.add(f"    if len({element}) > {field.string_length}: _raise('string of', len({element}))")
    source.known(1)


def _array_converter(found: Definition, field: Field) -> Any:
    return lambda value: as_array(value, field, found.type_name)


def _make_decoder(kind: type[Message], modulus: int, order: str) -> Any:
    source = _Source(order)
    source.known(modulus)
    result = _decode_fields(source, kind)
    _flush_in(source)
    source.add(*result[1], f"return {result[0]}, pos")
    return source.function("def _function(b, pos, size):", f"<decoder of {kind.type_name}>")


def _decode_fields(source: _Source, kind: type[Message]) -> tuple[str, list[str]]:
    """Return the name of the message and the lines that build it from the read values."""
    message, class_name = source.name("m"), source.constant("class", kind)
    lines = [f"{message} = _new({class_name})"]
    if not kind.definition.fields:
        source.pending.append((source.name("unused"), "B", 1))
    for field in kind.definition.fields:
        if field.array is None and field.nested:
            value, more = _decode_fields(source, kind.nested[field.name])
            lines += more
        else:
            value = source.name("v")
            if field.array is not None:
                _decode_array(source, kind, field, value)
            elif field.base == STRING:
                source.pending.append((value, "I", 4))
                _flush_in(source)
                _decode_string(source, value, field, "")
            else:
                source.pending.append((value, *PRIMITIVES[field.base]))
        lines.append(f"{message}.{field.attribute} = {value}")
    return message, lines


def _flush_in(source: _Source) -> None:
    """Add the lines that unpack the pending numbers."""
    for align, members, layout in source.groups():
        if align > 1:
            source.add(f"pos = pos + {align - 1} & {-align}")
        if members:
            unpack = source.constant("unpack", layout.unpack_from)
            targets = ", ".join(name for name, _ in members)
            source.add(f"{targets}, = {unpack}(b, pos)", f"pos += {layout.size}")


def _decode_string(source: _Source, name: str, field: Field, indent: str) -> None:
    """Add lines that replace the length in a variable by the string of that length."""
    lines = [
        f"if {name}:",
        f"    end = pos + {name}",
        f"    if end > size: _raise('string of', {name})",
        f"    {name} = str(b[pos : end - (b[end - 1] == 0)], 'utf-8')",
        "    pos = end",
        f"else: {name} = ''",
    ]
    if field.string_length:
        lines.append(f"if len({name}) > {field.string_length}: _raise('string of', len({name}))")
    source.add(*(indent + line for line in lines))
    source.known(1)


def _decode_array(source: _Source, kind: type[Message], field: Field, name: str) -> None:
    """Add the lines that decode an array or a sequence into a variable."""
    count: str = str(field.length)
    if field.array != FIXED:
        count = source.name("n")
        source.pending.append((count, "I", 4))
    _flush_in(source)
    if field.array == BOUNDED:
        source.add(f"if {count} > {field.length}: _raise('sequence of', {count})")
    if field.base in PRIMITIVES:
        _decode_numbers(source, field, name, count)
        return
    least = least_size(kind.nested[field.name]) if field.nested else 4
    source.add(f"if {count} > (size - pos) // {least}: _raise('sequence of', {count})")
    element = source.name("e")
    source.add(f"{name} = []", f"for _ in range({count}):")
    if field.nested:
        inner = _cached(kind.nested[field.name], 1, source.order, _decoders, _make_decoder)
        decode = source.constant("decode", inner)
        source.add(f"    {element}, pos = {decode}(b, pos, size)")
    else:
        unpack = source.constant("unpack", struct.Struct(source.order + "I").unpack_from)
        source.add("    pos = pos + 3 & -4", f"    {element}, = {unpack}(b, pos)", "    pos += 4")
        _decode_string(source, element, field, "    ")
    source.add(f"    {name}.append({element})")
    source.known(1)


def _decode_numbers(source: _Source, field: Field, name: str, count: str) -> None:
    """Add the lines that decode an array of numbers as a view of the bytes."""
    size = PRIMITIVES[field.base][1]
    stored = DTYPES["uint8" if field.base == "bool" else field.base]
    swapped = size > 1 and source.order == ">"
    dtype = source.constant("dtype", stored.newbyteorder(">") if swapped else stored)
    empty = source.constant("empty", EMPTY[field.base])
    source.add(f"if {count}:")
    if size > source.modulus or source.offset % size:
        source.add(f"    pos = pos + {size - 1} & {-size}")
    source.add(
        f"    if {count} > (size - pos) // {size}: _raise('array of', {count})",
        f"    {name} = _frombuffer(b, {dtype}, {count}, pos)" + (" != 0" if field.base == "bool" else ""),
        *((f"    {name} = _native({name})",) if swapped else ()),
        f"    pos += {count} * {size}" if size > 1 else f"    pos += {count}",
        f"else: {name} = {empty}",
    )
    source.known(size if field.array == FIXED else min(size, 4))


def _native(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return a read-only copy of an array in this machine's byte order."""
    array = array.astype(array.dtype.newbyteorder("="))
    array.flags.writeable = False
    return array


def _raise(what: str, length: int) -> None:
    raise ValueError(f"{what} {length} elements")


def _refuse_nul() -> None:
    raise ValueError("string with NUL")
