"""Tables say what they were given, and are told from broken ones."""

import pytest

from pypose_lite.teaching import table


def test_a_table_has_names_on_the_left_and_numbers_on_the_right():
    shown = table("filter | error (m) | NEES", ["EKF | 0.055 | 4.02", "UKF | 0.054 | 4.00"])
    assert shown.data.splitlines() == [
        "| filter | error (m) | NEES |",
        "| :-- | --: | --: |",
        "| EKF | 0.055 | 4.02 |",
        "| UKF | 0.054 | 4.00 |",
    ]


def test_rows_may_come_one_by_one_and_cells_may_be_empty():
    shown = table("loop | steps", (f"{name} | " for name in ("raw", "filter")))
    assert shown.data.splitlines()[2:] == ["| raw |  |", "| filter |  |"]


@pytest.mark.parametrize("row", ["EKF", "EKF | 0.055 | 4.02"])
def test_a_row_that_does_not_fit_the_head_is_refused(row):
    with pytest.raises(ValueError, match="rows: expected 2 cells, as in 'filter | error'"):
        table("filter | error", [row])
