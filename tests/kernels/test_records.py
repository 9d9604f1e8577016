"""Records in memory: each field against NumPy's structured arrays, and the keys of code that uses them."""

import numpy as np
import pytest

from pepper_kin.kernels.compiled_function import compiled, unit_of
from pepper_kin.kernels.lanes import lanes, load_lanes, single_at
from pepper_kin.kernels.records import RecordView, double, single, word
from pepper_kin.kernels.signatures import Bytes1, Floats1

MIXED = RecordView(
    "MIXED",
    number=double,
    pair=2 * single,
    count=word,
    block=2 * lanes,
    small=single.padded(8),
    point=3 * double,
)
NUMPY = np.dtype(
    [
        ("number", "f8"),
        ("pair", "f4", 2),
        ("count", "i8"),
        ("block", "f4", (2, 8)),
        ("small", "f4"),
        ("unused", "f4"),
        ("point", "f8", 3),
    ]
)
load_count = MIXED.count


@compiled("void(uint8[::1], int64, float64[::1])")
def read_fields(memory: Bytes1, k: int, found: Floats1) -> None:
    rows = memory.ctypes.data
    row = MIXED.at(rows, k)
    a, b = MIXED.pair(row)
    x, y, z = MIXED.point(rows, k)
    found[0], found[1], found[2], found[3] = MIXED.number(row), a, b, MIXED.count(rows, k)
    found[4], found[5], found[6], found[7] = MIXED.small(row), x, y, z
    found[8], found[9] = single_at(MIXED.block_at(rows, k), 11), load_count(row)


@compiled("void(uint8[::1], int64, float64)")
def write_fields(memory: Bytes1, k: int, value: float) -> None:
    rows = memory.ctypes.data
    row = MIXED.at(rows, k)
    first, second = MIXED.block(rows, k)
    MIXED.set_number(row, value)
    MIXED.set_pair(rows, (value + 1.0, value + 2.0), k)
    MIXED.set_count(row, 7)
    MIXED.set_block(row, (first + second, load_lanes(MIXED.block_at(rows, k), 1)))
    MIXED.set_small(rows, value + 3.0, k)
    MIXED.set_point(row, (value, value + 4.0, value + 5.0))


def random_rows() -> np.ndarray:
    rng, rows = np.random.default_rng(0), np.zeros(5, NUMPY)
    for name in NUMPY.names:
        rows[name] = rng.integers(-100, 100, rows[name].shape)
    return rows


@pytest.mark.parametrize("read", [read_fields, read_fields.python], ids=["compiled", "interpreted"])
def test_fields_are_where_numpy_has_them(read):
    rows, found = random_rows(), np.zeros(10)
    assert MIXED.size == NUMPY.itemsize
    for k in range(5):
        read(rows.view(np.uint8), k, found)
        row = rows[k]
        expected = [row["number"], *row["pair"], row["count"], row["small"], *row["point"]]
        np.testing.assert_array_equal(found, [*expected, row["block"][1, 3], row["count"]])


@pytest.mark.parametrize("write", [write_fields, write_fields.python], ids=["compiled", "interpreted"])
def test_fields_are_written_where_numpy_has_them_and_nothing_else_is(write):
    rows = random_rows()
    expected = rows.copy()
    expected["block"][3, 0] += expected["block"][3, 1]
    expected["number"][3], expected["pair"][3], expected["count"][3] = 0.5, (1.5, 2.5), 7
    expected["small"][3], expected["point"][3] = 3.5, (0.5, 4.5, 5.5)
    write(rows.view(np.uint8), 3, 0.5)
    assert rows.tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("MIXED", RecordView("MIXED", first=word, **MIXED.fields)),  # all places change
        ("MIXED", RecordView("MIXED", **MIXED.fields, last=word)),  # rows are longer
        ("load_count", RecordView("MIXED", first=word, **MIXED.fields).count),
    ],
)
def test_another_layout_gives_other_keys_of_the_code_that_uses_it(monkeypatch, name, other):
    unit = unit_of(__name__)
    key = unit.key()
    same = RecordView("MIXED", **MIXED.fields)
    with monkeypatch.context() as patch:
        patch.setitem(globals(), name, same if name == "MIXED" else same.count)
        assert unit.key() == key
    monkeypatch.setitem(globals(), name, other)
    assert unit.key() != key


def test_a_row_is_written_by_names_and_all_of_them_have_to_be_given():
    ball = RecordView("BALL", center=3 * single, outer=single)
    assert ball.row(outer=4.0, center=np.array([1.0, 2.0, 3.0])) == [1.0, 2.0, 3.0, 4.0]
    assert (ball.columns.center, ball.columns.outer, ball.width) == (slice(0, 3), 3, 4)
    with pytest.raises(TypeError, match="fields center, outer; given: \\['outer'\\]"):
        ball.row(outer=4.0)
    with pytest.raises(AttributeError, match="'inner'; its fields: center, outer"):
        _ = ball.inner
    with pytest.raises(TypeError, match="row cannot be"):
        RecordView("BALL", row=single)
