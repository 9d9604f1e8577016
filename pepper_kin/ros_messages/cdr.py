"""Messages as bytes and back: CDR of version 1, the encoding of ROS 2's messages in DDS, MCAP and bags.

Both byte orders are read; little-endian is written.

Source: OMG, Common Object Request Broker Architecture 3.3, part 2, section 9.3, and DDS Interoperability 2.5:
four bytes of encapsulation, then the fields; numbers are aligned to their size; a string is its length with
the final NUL, and UTF-8; a sequence is its length and its elements.

For each type a function is generated and compiled by Python (`pepper_kin.ros_messages.cdr_functions`), so
that adjacent numbers are read by one call of `struct`; rosbags, with a call for each number, takes 1.3 times
(an image) to 3 times as long (`docs/design.md`).
"""

from __future__ import annotations

import struct
from typing import TypeVar

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ros_messages.cdr_functions import decoder, encoder
from pepper_kin.ros_messages.errors import MessageError
from pepper_kin.ros_messages.messages import Message, check_message

_Message = TypeVar("_Message", bound=Message)

ENCAPSULATION = b"\x00\x01\x00\x00"
"""First bytes of a message in little-endian CDR of version 1."""

_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


def encode(message: Message) -> bytes:
    """Encode a message as bytes.

    Raises:
        InvalidValueError: for a value that its type cannot hold, with the field's name.
    """
    out = bytearray(ENCAPSULATION)
    try:
        encoder(type(message))(message, out)
    except (struct.error, TypeError, ValueError, AttributeError, OverflowError) as error:
        check_message(message, type(message))
        raise InvalidValueError(type(message).type_name, message, f"a valid message ({error})") from error
    return bytes(out)


def decode(kind: type[_Message], data: bytes | bytearray | memoryview) -> _Message:
    """Decode a message; its arrays are read-only views of the bytes, or copies if they are big-endian.

    Bytes after the last field are ignored: middleware pads messages to an estimated size.

    Args:
        kind: Class of the message.
        data: Bytes from any source: every length is checked before memory is reserved.

    Raises:
        MessageError: for bytes that do not hold a message of the type, with the reason.
    """
    view = memoryview(data).toreadonly()
    order = _ORDERS.get(bytes(view[:2]))
    if view.nbytes < 4 or order is None:
        got = bytes(view[:2]).hex() or "no bytes"
        raise MessageError(kind.type_name, f"begins with {got}, expected 0000 or 0001 (CDR of version 1)")
    body = view[4:]
    try:
        message, _ = decoder(kind, order)(body, 0, body.nbytes)
    except (struct.error, ValueError, IndexError) as error:  # UnicodeDecodeError is a ValueError
        raise MessageError(kind.type_name, f"is cut off or damaged, {body.nbytes} bytes: {error}") from None
    return message
