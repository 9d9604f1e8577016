"""Tables at addresses: what compiled functions read of them, what is refused, and the keys of their code."""

from typing import NamedTuple

import numpy as np
import pytest

from pepper_kin.kernels.compiled_function import compiled, unit_of
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats3, Ints2, Singles1
from pepper_kin.kernels.tables import TableMemory, table_reader


class Inner(NamedTuple):
    cube: Floats3
    factor: float


class Outer(NamedTuple):
    on: bool
    count: int
    inner: Inner
    places: Ints2
    flags: Flags1
    singles: Singles1
    result: Floats1
    big: "uint64"  # noqa: F821


class Longer(NamedTuple):
    first: int
    on: bool
    count: int
    inner: Inner
    places: Ints2
    flags: Flags1
    singles: Singles1
    result: Floats1
    big: "uint64"  # noqa: F821


outer_at = table_reader(Outer)


@compiled("int64(int64)", by_address=True)
def read_all(address: int) -> int:
    """Write something of each field to `result`; return the number of bits of `big`."""
    t = outer_at(address)
    t.result[0] = t.inner.cube[1, 0, 2] * t.inner.factor
    t.result[1] = t.places[1, 0] + t.places.shape[0] * 100
    t.result[2] = t.count + t.singles[1] + t.inner.cube.shape[2] * 1000
    t.result[3] = 1.0 if t.on and t.flags[2] and not t.flags[1] else 0.0
    return t.big >> 60


def values() -> dict:
    rng = np.random.default_rng(0)
    return {
        "on": True,
        "count": -7,
        "inner": Inner(rng.uniform(size=(2, 1, 3)), 0.3),
        "places": rng.integers(-9, 9, (4, 2)),
        "flags": np.array([False, False, True]),
        "singles": np.array([0.25, -1.75], np.float32),
        "result": np.zeros(4),
        "big": 2**64 - 1,
    }


@pytest.mark.parametrize("read", [read_all, read_all.python], ids=["compiled", "interpreted"])
def test_all_kinds_of_fields_are_read(read):
    given = values()
    assert read(TableMemory(Outer, **given).address) == 15
    inner, places = given["inner"], given["places"]
    expected = [inner.cube[1, 0, 2] * 0.3, 400 + places[1, 0], 2993 + float(given["singles"][1]), 1.0]
    np.testing.assert_array_equal(given["result"], expected)


def test_fields_are_replaced_and_arrays_live_as_long_as_the_memory():
    table = TableMemory(Outer, **values())
    table.set(places=np.array([[0, 5], [0, 0]]).T, on=False)  # a view that is not contiguous
    copy = table.with_values(result=np.zeros(4), count=1)
    result = np.full(4, -1.0)
    table.set(result=result)
    read_all(table.address)
    assert result[1] == 205.0
    assert result[3] == 0.0
    before = result.copy()
    read_all(copy.address)
    np.testing.assert_array_equal(result, before)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("places", np.zeros((4, 2)), "Outer.places has 2 axes, of int64; given: shape .4, 2., float64"),
        ("result", np.zeros((4, 1)), "Outer.result has 1 axes"),
        ("count", 1.5, "Outer.count has 0 axes, of int64"),
        ("inner", Inner(np.zeros(3), 1.0), "Outer.inner.cube has 3 axes"),
        ("inner", (np.zeros((1, 1, 1)), 1.0), "Outer.inner is a Inner"),
        ("other", 1, "no field of a table: Outer.other; they are on, count"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(field, value, words):
    table = TableMemory(Outer, **values())
    before = table.words.copy()
    with pytest.raises(TypeError, match=words):
        table.set(**{field: value})
    np.testing.assert_array_equal(table.words, before)
    with pytest.raises(TypeError, match="table Outer lacks count, on"):
        TableMemory(Outer, **{name: own for name, own in values().items() if name not in ("on", "count")})


def test_another_declaration_gives_another_key(monkeypatch):
    unit = unit_of(__name__)
    key = unit.key()
    monkeypatch.setitem(globals(), "outer_at", table_reader(Outer))
    assert unit.key() == key
    Longer.__name__ = Outer.__name__
    monkeypatch.setitem(globals(), "outer_at", table_reader(Longer))
    assert unit.key() != key
