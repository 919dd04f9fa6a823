"""Tables say what they were given, and are told from broken ones."""

import pytest

from pypose_lite.teaching import table


def cells(shown):
    """The lines of a table, without the spaces that line its columns up."""
    return [[cell.strip() for cell in line.split("|")] for line in shown.data.splitlines()]


def test_a_table_has_names_on_the_left_and_numbers_as_they_come_to_the_right():
    head, rule, *rows = cells(table("filter | error (m)", ["EKF | 0.0550", "UKF | 1e-3"]))
    assert head == ["", "filter", "error (m)", ""]
    assert rule[1].startswith(":-") and rule[1].endswith("--") and rule[2].endswith("-:")
    assert rows == [["", "EKF", "0.0550", ""], ["", "UKF", "1e-3", ""]]


def test_rows_may_come_one_by_one_and_cells_may_be_empty():
    _, _, *rows = cells(table("loop | steps", (f"{name} | " for name in ("raw", "filter"))))
    assert rows == [["", "raw", "", ""], ["", "filter", "", ""]]


@pytest.mark.parametrize("row", ["EKF", "EKF | 0.055 | 4.02"])
def test_a_row_that_does_not_fit_the_head_is_refused(row):
    with pytest.raises(ValueError, match="rows: expected 2 cells, as in 'filter | error'"):
        table("filter | error", [row])
