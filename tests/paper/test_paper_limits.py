import json

import pytest

import pepper_kin as pk
from pepper_kin.paper import limits_table


def test_the_table_has_the_papers_17_rows():
    table = limits_table()
    names = [row.joint for row in table.rows]
    assert len(names) == 17
    assert names[:5] == ["HeadYaw", "HeadPitch", "HipRoll", "HipPitch", "KneePitch"]
    assert set(names) == set(pk.load_pepper(hands="mimic").joint_names)


def test_ours_are_the_published_digits():
    rows = {row.joint: row for row in limits_table().rows}
    assert rows["HeadPitch"].ours == (-0.706858, 0.637045)
    assert rows["LShoulderRoll"].ours == (0.00872665, 1.56207)
    assert rows["KneePitch"].ours == (-0.514872, 0.514872)


def test_the_papers_errors_are_recomputed():
    """Table 4 prints the mean absolute error between its two columns; it must follow from them."""
    for row in limits_table().rows:
        assert row.paper_error == pytest.approx(row.printed_error, abs=1e-9), row.joint


def test_gazebo_is_ours_rounded_and_choregraphe_is_not():
    table = limits_table()
    for row in table.rows:
        assert tuple(round(value, 2) for value in row.ours) == row.gazebo
        assert row.explained_by_rounding == (False, False), row.joint
    assert table.mean_error == pytest.approx(0.0134, abs=5e-5)
    assert table.mean_gazebo_error < 0.005


def test_report_says_what_lies_outside():
    report = limits_table().report()
    assert "34 of Choregraphe's 34 values differ by more than the 0.005 rad that rounding" in report
    assert "28 lie within our range, by up to 0.0185 rad;" in report
    assert (
        "6 lie beyond it, by up to 0.0100 rad: LShoulderRoll lower, LElbowRoll upper, LHand lower" in report
    )
    assert json.loads(json.dumps(limits_table().to_dict()))["rows"][0]["joint"] == "HeadYaw"


def test_a_robot_without_hands_is_refused():
    with pytest.raises(pk.PepperKinError, match="unknown joint 'LHand'"):
        limits_table(pk.load_pepper())
