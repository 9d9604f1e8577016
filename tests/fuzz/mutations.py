"""Damage of files: bytes, tokens, elements and nesting, each case from a seeded generator alone."""

import copy
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator

NUMBERS = (
    "nan", "-nan", "inf", "-inf", "Infinity", "1e308", "-1e308", "1e309", "1e200", "1e30", "1e9", "1e-320",
    "-1",
    "-0.0", "0", "2.5", "1_0", "0x1p3", "0x10", "\u0661\u0662", "\uff11", "1e", "1,5", "1 2", "+ 1", "--1",
    "",
    " ", "true", "True", "null", "None", "~",
    "9" * 5000, "-" + "9" * 5000, "1" + "0" * 400, "0." + "1" * 5000,
    "9223372036854775808", "4294967296", "1e5000", "0o7", "\u221e", "\ud800", "1\x00", "[]", "{}", "1j",
)  # fmt: skip
WORDS = (
    "", " ", "a/b", "../../etc", "/", ".", "..", "\\", "a\nb", "a\tb", "\u0661", "\u00e9\u00df\u732b",
    "\U0001f600",
    "\ud800", "\udfff", "x" * 10_000, "<", "&amp;", "]]>", "%s%n", "{0}", "${x}", "nan", "1", "None",
    "a" * 300 + "/b",
    "package://", "file://", "package://../..", "\u202egnp", "\x7f", "--", "a,b", '"', "'",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2.5, 1e308, -1e308, 1e-320, 10**30, -(10**30), 2**63, 2**64, "", "1",
    "1.0", "nan",
    "\u0661", "x" * 10_000, [], {}, [[]], [1], [True], [None], [1, [2]], {"a": 1}, [0] * 1000, float("nan"),
    float("inf"), "\ud800",
)  # fmt: skip
DEEP = 10_000
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"\"[^\"<>]*\"|'[^'<>]*'|[A-Za-z_][\w.:/-]*")
_BOMB = (
    '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {b} "{("&" + a + ";") * 10}">' for a, b in zip("abcdefghi", "bcdefghij", strict=True)
    )
    + "]>"
)


def pick(rng: Rng, items: Any) -> Any:
    """Return one item of a sequence."""
    return items[int(rng.integers(len(items)))]


def encoded(text: str) -> bytes:
    """Return a text as bytes; halves of surrogate pairs become the bytes that no UTF-8 has."""
    return text.encode("utf-8", "surrogatepass")


def changed_bytes(content: bytes, rng: Rng, others: tuple[bytes, ...] = ()) -> bytes:
    """Flip, cut, double, insert, splice: whatever may happen to a file."""
    data = bytearray(content or b"\0")
    a, b = sorted(int(i) for i in rng.integers(0, len(data) + 1, 2))
    b = min(b, a + 400) if rng.random() < 0.7 else b
    kind = int(rng.integers(12))
    if kind <= 2:
        for place in rng.integers(0, len(data), int(rng.integers(1, 9))):
            data[place] ^= 1 << int(rng.integers(8))
    elif kind == 3:
        del data[a:]
    elif kind == 4:
        del data[a:b]
    elif kind == 5:
        data[b:b] = data[a:b] * int(rng.integers(1, 4))
    elif kind == 6:
        data[a:a] = rng.integers(0, 256, int(rng.integers(1, 40))).astype(np.uint8).tobytes()
    elif kind == 7:
        data[a:b] = bytes(b - a)
    elif kind == 8:
        marks = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff", b"\x00", b"\n\n", b"\x1f\x8b", b"PK\x03\x04")
        data[:0] = pick(rng, marks)
    elif kind == 9:
        for place in rng.integers(0, len(data), 3):
            data[place] = int(pick(rng, (0, 1, 0x7F, 0x80, 0xFF)))
    elif kind == 10:
        size = int(pick(rng, (1, 2, 4, 8)))
        data[a : a + size] = int(rng.integers(0, 2**62)).to_bytes(8, "little")[:size]
    else:
        other = pick(rng, others) if others else content
        cut = int(rng.integers(0, len(other) + 1))
        data[a:] = other[cut:]
    return bytes(data)


def changed_text(text: str, rng: Rng) -> str:
    """Replace numbers and words, double, remove, move and nest lines."""
    kind = int(rng.integers(10))
    if kind <= 3:
        return _replaced(text, _NUMBER, lambda: str(pick(rng, NUMBERS)), rng)
    if kind <= 5:
        word = str(pick(rng, WORDS))
        return _replaced(text, _WORD, lambda: word if rng.random() < 0.5 else f'"{word}"', rng)
    if kind == 6:
        return _nested(text, rng)
    lines = text.split("\n")
    i, j = (int(k) for k in rng.integers(0, len(lines), 2))
    if kind == 7:
        lines.insert(j, lines[i])
    elif kind == 8:
        del lines[i]
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return "\n".join(lines)


def _replaced(text: str, pattern: re.Pattern[str], new: Callable[[], str], rng: Rng) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text + new()
    many = 1 if rng.random() < 0.8 else 3
    for place in sorted((int(i) for i in rng.integers(0, len(found), many)), reverse=True):
        text = text[: found[place].start()] + new() + text[found[place].end() :]
    return text


def _nested(text: str, rng: Rng) -> str:
    opening, closing = pick(
        rng,
        (
            ("[", "]"),
            ("{", "}"),
            ("(", ")"),
            ('{"a":', "}"),
            ("<a>", "</a>"),
            ("- ", ""),
            ("-", ""),
            ("{a: ", "}"),
        ),
    )
    depth = int(pick(rng, (3, 100, 1000, DEEP)))
    found = list(_NUMBER.finditer(text)) or [re.match("", text)]
    match = pick(rng, found)
    whole = opening * depth + match.group() + closing * depth * int(rng.integers(2))
    return text[: match.start()] + whole + text[match.end() :]


def changed_json(content: Any, rng: Rng) -> str:
    """Replace, remove, double and move parts of what JSON holds."""
    whole = [copy.deepcopy(content)]
    places: list[tuple[Any, Any]] = []
    waiting: list[Any] = [whole]
    while waiting:
        part = waiting.pop()
        keys = list(part) if isinstance(part, dict) else list(range(len(part)))
        places += [(part, key) for key in keys]
        waiting += [part[key] for key in keys if isinstance(part[key], (dict, list))]
    for _ in range(1 if rng.random() < 0.8 else 3):
        part, key = pick(rng, places)
        kind = int(rng.integers(6))
        if kind <= 2 or (kind == 3 and part is whole):
            part[key : key + 1] if isinstance(part, list) else None
            _put(part, key, copy.deepcopy(pick(rng, VALUES)))
        elif kind == 3:
            _remove(part, key)
        elif kind == 4:
            _double(part, key, str(pick(rng, WORDS)))
        else:
            other, place = pick(rng, places)
            _put(part, key, copy.deepcopy(_get(other, place)))
    text = json.dumps(whole[0] if whole else None)
    if rng.random() < 0.1:
        text = text.replace("0.5", "9" * 5000, 1).replace("1.0", "-" + "1" * 5000, 1)
    return text


def _get(part: Any, key: Any) -> Any:
    try:
        return part[key]
    except (KeyError, IndexError):
        return None


def _put(part: Any, key: Any, value: Any) -> None:
    if isinstance(part, dict) or key < len(part):
        part[key] = value


def _remove(part: Any, key: Any) -> None:
    if isinstance(part, dict):
        part.pop(key, None)
    else:
        del part[key : key + 1]


def _double(part: Any, key: Any, name: str) -> None:
    if isinstance(part, dict):
        part[name] = copy.deepcopy(_get(part, key))
    else:
        part.insert(key, copy.deepcopy(_get(part, key)))


def changed_xml(text: str, rng: Rng) -> str:
    """Remove, double, rename, move and nest elements, change attributes, or declare entities."""
    root = ET.fromstring(text)
    nodes = list(root.iter())
    parents = {child: parent for parent in nodes for child in parent}
    for _ in range(1 if rng.random() < 0.7 else 4):
        node = pick(rng, nodes)
        parent = parents.get(node)
        kind = int(rng.integers(10))
        if kind == 0 and parent is not None and node in list(parent):
            parent.remove(node)
        elif kind == 1 and parent is not None:
            parent.append(copy.deepcopy(node))
        elif kind == 2:
            node.tag = pick(rng, [other.tag for other in nodes] + ["x", "robot", "link", "joint"])
        elif kind == 3:
            pick(rng, nodes).append(copy.deepcopy(node) if len(list(node.iter())) < 50 else ET.Element("x"))
        elif kind == 4 and node.attrib:
            del node.attrib[pick(rng, list(node.attrib))]
        elif kind in (5, 6) and node.attrib:
            node.set(pick(rng, list(node.attrib)), _writable(str(pick(rng, NUMBERS + WORDS))))
        elif kind == 7 and node.attrib:
            other = pick(rng, nodes)
            if other.attrib:
                node.set(pick(rng, list(node.attrib)), other.get(pick(rng, list(other.attrib))) or "")
        elif kind == 8 and node.attrib:
            key = pick(rng, list(node.attrib))
            node.set(
                key, _replaced(node.get(key) or "", _NUMBER, lambda: _writable(str(pick(rng, NUMBERS))), rng)
            )
        else:
            node.text = _writable(str(pick(rng, WORDS)))
    found = ET.tostring(root, encoding="unicode")
    if rng.random() < 0.04:
        depth, tag = int(pick(rng, (50, 300, DEEP))), pick(rng, ("a", "link", "group", "Box"))
        place = found.index(">") + 1
        found = found[:place] + f"<{tag}>" * depth + f"</{tag}>" * depth + found[place:]
    if rng.random() < 0.04:
        found = _BOMB + found.replace('="', '="&j;', 1)
    if rng.random() < 0.04:
        declared = pick(rng, ("utf-16", "ascii", "utf-7", "latin-1", "cp037", "nothing", ""))
        found = f'<?xml version="1.0" encoding="{declared}"?>' + found
    return found


def _writable(text: str) -> str:
    """Return a text whose characters XML has, all but the odd one."""
    return text.replace("\x00", "\x01")


def changed_arrays(arrays: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """Change names, types, shapes and numbers of arrays."""
    found = {name: np.array(value) for name, value in arrays.items()}
    name = str(pick(rng, sorted(found)))
    array = found[name]
    kind = int(rng.integers(10))
    if kind == 0:
        del found[name]
    elif kind == 1:
        found[str(pick(rng, ("x", "", "a/b", "../x", "\u732b")))] = array
    elif kind == 2:
        found[name] = array.reshape(-1)[: int(rng.integers(0, array.size + 1))]
    elif kind == 3:
        found[name] = np.array([array, array])
    elif kind == 4:
        kinds = ("<f4", "<i8", "<c16", "?", "<U3", "S4", "<M8[s]", "<u1", "f2")
        with np.errstate(all="ignore"):
            try:
                found[name] = array.astype(pick(rng, kinds))
            except (ValueError, TypeError):
                found[name] = np.frombuffer(array.tobytes(), "u1")
    elif kind == 5:
        found[name] = np.array(pick(rng, (np.nan, np.inf, -1, 1e308, 2**63 - 1, True, "text", "", "rad")))
    elif kind == 6:
        found[name] = np.zeros(int(pick(rng, (0, 1, 10, 2_000_000))), pick(rng, ("u1", "f8")))
    elif array.size and array.dtype.kind in "fiu":
        flat = array.reshape(-1)
        values = (np.nan, np.inf, -1.0, 1e308, 1e-320, 0.0, 255.0) if array.dtype.kind == "f" else (0, 1, 127)
        flat[int(rng.integers(flat.size))] = pick(rng, values)
        found[name] = flat.reshape(array.shape)
    elif array.size and array.dtype.kind == "U":
        flat = array.reshape(-1).astype(object)
        flat[int(rng.integers(flat.size))] = str(pick(rng, WORDS)).replace("\x00", "")
        found[name] = flat.reshape(array.shape).astype(str)
    return found
