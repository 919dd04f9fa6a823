"""The page of benchmarks: its tables, from what pytest-benchmark records."""

import benchmarks
import pytest


def record(side, seconds, file="mpc", group="One plan", **notes):
    """A benchmark as it stands in the record."""
    return {
        "fullname": f"tests/bench/bench_{file}.py::test_x[{side}]",
        "group": group,
        "stats": {"min": seconds, "median": 3 * seconds},
        "extra_info": {"side": side, **notes},
    }


def cells(table):
    """The rows of a table, without the line under its head."""
    head, _, *rows = ([c.strip() for c in line.split("|")[1:-1]] for line in table.splitlines())
    return [head, *rows]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(2.0, "2 s"), (1.0, "1 s"), (0.0123456, "12.3 ms"), (1e-3, "1 ms"), (4.2e-5, "42 µs")],
)
def test_a_duration_has_three_digits_and_a_unit(seconds, text):
    assert benchmarks.duration(seconds) == text


@pytest.mark.parametrize(
    ("worse", "text"),
    [(0.1588, "+16 %"), (2e-4, "+0.02 %"), (9e-5, "none"), (-1e-12, "none")],
)
def test_an_excess_is_in_percent_and_none_where_it_is_not_worth_a_word(worse, text):
    assert benchmarks.excess(worse) == text


@pytest.mark.parametrize(
    ("value", "text"), [(8.0, "8.00"), (0.104, "0.10"), (0.0996, "0.1"), (0.00432, "0.0043")]
)
def test_a_small_ratio_keeps_two_digits(value, text):
    assert benchmarks.ratio(value) == text


def test_the_time_of_a_side_that_did_a_share_is_that_of_all():
    assert benchmarks.seconds(record("ours", 0.5)) == 0.5
    assert benchmarks.seconds(record("IPOPT", 0.5, share=0.25)) == 2.0


def test_ratios_are_to_ours_wherever_it_stands():
    assert cells(benchmarks.table([record("PyPose", 0.3), record("ours", 0.2)])) == [
        ["", "time", "times ours"],
        ["PyPose", "300 ms", "1.50"],
        ["ours", "200 ms", "1.00"],
    ]


def test_ratios_are_to_the_first_row_where_nobody_is_ours():
    head, _, last = cells(benchmarks.table([record("one car", 2e-6), record("9 cars", 8e-6)]))
    assert head == ["", "time", "times one car"]
    assert last == ["9 cars", "8 µs", "4.00"]


def test_a_batch_has_the_time_of_each():
    rows = [record("ours", 0.2, count=100), record("IPOPT", 0.2, count=100, share=0.1)]
    assert cells(benchmarks.table(rows)) == [
        ["", "time", "time each", "times ours"],
        ["ours", "200 ms", "2 ms", "1.00"],
        ["IPOPT", "2 s", "20 ms", "10.00"],
    ]


def test_numbers_stand_on_the_right():
    _, line, _ = benchmarks.table([record("ours", 0.2)]).splitlines()
    assert [(cell[0], cell[-1]) for cell in line.split("|")[1:-1]] == [
        (":", "-"),
        ("-", ":"),
        ("-", ":"),
    ]


def test_a_worse_answer_is_shown():
    rows = [record("ours", 0.2, worse=0.0), record("PyPose", 0.3, worse=0.27)]
    head, *rows = cells(benchmarks.table(rows))
    assert head[-1] == "cost above the best"
    assert [row[-1] for row in rows] == ["none", "+27 %"]


def test_sweeps_are_counted_where_a_benchmark_says_how_many():
    rows = [record("ours", 0.2, sweeps=4, worse=0.0), record("PyPose", 0.3, sweeps=5, worse=0.0)]
    head, *rows = cells(benchmarks.table(rows))
    assert head[-2:] == ["sweeps", "cost above the best"]
    assert [row[-2] for row in rows] == ["4", "5"]


def test_topics_and_groups_stand_in_their_own_order_and_a_topic_says_what_it_compares():
    measured = [
        record("ours", 1, "filters", "One EKF step"),
        record("ours", 1, group="One plan of 20 steps"),
        record("ours", 1, group="One plan of 100 steps"),
        record("PyPose", 5, group="One plan of 20 steps"),
    ]
    text = "\n\n".join(benchmarks.topics(measured))
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        "## Planning",
        "### One plan of 20 steps",
        "### One plan of 100 steps",
        "## Filters",
        "### One EKF step",
    ]
    assert "## Planning\n\nOne plan of the infinity, cold and warm" in text
    assert text.count("5.00") == 1


def test_every_topic_is_a_file():
    for stem in benchmarks.TOPICS:
        assert (benchmarks.ROOT / "tests" / "bench" / f"{stem}.py").exists()
