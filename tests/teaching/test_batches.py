"""The record of what a car of a batch costs: what is measured, and what is kept."""

import pytest
import torch

from pypose_lite.teaching import batches


def test_the_record_has_a_positive_time_for_each_size():
    record = batches.record()
    assert [*map(int, record["step"])] == list(batches.CARS)
    assert [*map(int, record["plan"])] == list(batches.HORIZONS)
    for row in record["plan"].values():
        assert [*map(int, row)] == list(batches.SIZES)
    rows = [record["step"], record["compiled"], *record["plan"].values()]
    assert all(seconds > 0 for row in rows for seconds in row.values())


def test_the_time_is_that_of_the_quickest_round(monkeypatch):
    clock = iter([0.0, 0.3, 1.0, 1.2, 2.0, 2.4])  # rounds of 0.3, 0.2, 0.4
    monkeypatch.setattr(batches.time, "process_time", lambda: next(clock))
    calls = []
    assert batches.seconds(lambda: calls.append(1)) == pytest.approx(0.2)
    assert len(calls) == 1 + 3  # the first is not counted


@pytest.fixture
def float64():
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(before)


def test_a_batch_of_plans_has_its_size_and_horizon(float64):
    x, u, _ = batches.plans(5, 3)()
    assert (x.shape, u.shape) == ((3, 6, 4), (3, 5, 2))


def test_a_batch_of_cars_moves_by_one_step(float64):
    assert batches.steps(7)().shape == (7, 4)
