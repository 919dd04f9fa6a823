"""The page of benchmarks as it is shown: plots from its tables, and tables folded."""

import pytest

from pypose_lite.teaching.site import speed

PAGE = """# Speed

What was measured.

## Planning

Beside others.

### One plan of 10 steps, cold

|        |    time |   times ours |
|:-------|--------:|-------------:|
| ours   | 11.9 ms |         1.00 |
| IPOPT  |  808 µs |         0.07 |

### One plan of 20 steps, cold

|        |    time |   times ours |
|:-------|--------:|-------------:|
| ours   |   1.5 s |         1.00 |

### One EKF step

|      | time |
|:-----|-----:|
| ours | 1 ms |
"""


def test_plots_come_before_the_first_section_and_say_what_they_show():
    page, pictures = speed.laid_out(PAGE)
    assert list(pictures) == ["speed_horizon.svg"]  # no batches, no plot of them
    assert page.index("```{image} speed_horizon.svg\n:alt: Time for one plan") < page.index("\n## ")
    assert pictures["speed_horizon.svg"].count("<svg") == 1


def test_each_table_is_folded_under_its_title():
    page, _ = speed.laid_out(PAGE)
    assert "###" not in page
    assert page.count(":::{dropdown} ") == page.count("\n:::\n") == 3
    assert ":::{dropdown} One EKF step\n|      | time |" in page


def test_points_are_the_numbers_of_the_tables():
    groups = {title: speed.rows_of(table) for title, table in speed.GROUP.findall(PAGE)}
    _, _, [(_, cold), _] = speed.PLOTS["speed_horizon.svg"]
    assert speed.times(groups, cold, "time") == {
        "ours": [(10, pytest.approx(0.0119)), (20, 1.5)],
        "IPOPT": [(10, pytest.approx(808e-6))],
    }


def test_a_plot_is_the_same_in_every_build():
    assert speed.laid_out(PAGE) == speed.laid_out(PAGE)


def test_a_page_without_tables_stays_as_it_is():
    assert speed.laid_out("# Speed\n\n## Planning\n\nNothing.\n")[1] == {}
