"""Studies: seeds for each task, workers that may die, files that are whole or not there."""

import os
import sys
from functools import partial

import cloudpickle
import pytest
import torch

from pypose_lite.teaching import study

cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers do not find this file
SETTINGS = {"seed": 3, "size": 4}
TASKS = range(6)


def draws(task, seed, size):
    """A result that depends on the seed, the task and the order of all that is drawn."""
    numbers = torch.randn(size, generator=study.generator(seed, task), dtype=torch.float64)
    return numbers.cumsum(0)


def expected(settings=SETTINGS):
    return [draws(task, **settings) for task in TASKS]


def same(results, others):
    return [torch.equal(a, b) for a, b in zip(results, others, strict=True)]


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def test_each_pair_of_seed_and_task_draws_other_numbers():
    pairs = [(seed, task) for seed in range(4) for task in range(4)]
    rows = torch.stack([torch.rand(3, generator=study.generator(*pair)) for pair in pairs])
    assert len(rows.unique(dim=0)) == len(pairs)
    again = torch.rand(3, generator=study.generator(2, 1))
    assert torch.equal(again, rows[pairs.index((2, 1))])


def test_tasks_of_a_study_differ_in_the_bits_that_torch_keeps():
    kept = [torch.rand(2, generator=torch.Generator().manual_seed(s)) for s in (5, 2**32 + 5)]
    assert torch.equal(*kept)  # it keeps 32 of them
    seeds = {study.generator(3, task).initial_seed() % 2**32 for task in range(200_000)}
    assert len(seeds) == 200_000


def test_the_draws_of_a_task_stay_the_same_over_the_years():
    """Else a study that is resumed with a newer version would mix two sets of draws."""
    assert study.generator(7, 0).initial_seed() == 2083679832
    assert study.generator(7, 1).initial_seed() == 2083679833


@pytest.mark.parametrize("count", [1, 2, 3])
def test_results_are_the_same_for_any_number_of_workers(count, tmp_path):
    with study.workers(count) as client:
        assert len(client.run(os.getpid)) == count
        results = study.run(draws, TASKS, SETTINGS, tmp_path, client)
    assert all(same(results, expected()))


def test_a_worker_that_is_killed_half_way_loses_nothing(tmp_path):
    def accident(done, client):
        if done == 2:
            killed.append(study.kill_a_worker(client))

    killed = []
    with study.workers(2) as client:
        before = set(client.run(os.getpid).values())
        kill = partial(accident, client=client)
        results = study.run(draws, range(20), SETTINGS, tmp_path, client, kill)
    assert before.issuperset(killed) and len(killed) == 1
    assert all(same(results, [draws(task, **SETTINGS) for task in range(20)]))


def test_a_study_goes_on_where_it_was_interrupted(tmp_path):
    def power_cut(done):
        if done == 4:
            raise KeyboardInterrupt

    def counted(task, **settings):
        asked.append(task)
        return draws(task, **settings)

    asked = []
    with pytest.raises(KeyboardInterrupt):
        study.run(counted, TASKS, SETTINGS, tmp_path, progress=power_cut)
    assert asked == [0, 1, 2, 3]
    counts = []
    results = study.run(counted, TASKS, SETTINGS, tmp_path, progress=counts.append)
    assert asked == [0, 1, 2, 3, 4, 5]
    assert counts == [5, 6]
    assert all(same(results, expected()))
    assert study.run(counted, [5, 0], SETTINGS, tmp_path)[0].equal(results[5])
    assert len(asked) == 6


def test_a_result_that_was_half_written_does_not_count(tmp_path, monkeypatch):
    def half(result, file):
        file.write_bytes(b"half of it")
        raise KeyboardInterrupt

    with monkeypatch.context() as broken, pytest.raises(KeyboardInterrupt):
        broken.setattr(torch, "save", half)
        study.run(draws, TASKS, SETTINGS, tmp_path)
    assert [name for name in files(tmp_path) if name.endswith(".pt")] == []
    assert all(same(study.run(draws, TASKS, SETTINGS, tmp_path), expected()))


def test_a_folder_refuses_results_of_other_settings(tmp_path):
    study.run(draws, TASKS, SETTINGS, tmp_path)
    kept = files(tmp_path)
    with pytest.raises(ValueError, match='"seed": 4.*with results of.*"seed": 3'):
        study.run(draws, TASKS, SETTINGS | {"seed": 4}, tmp_path)
    assert files(tmp_path) == kept


def fails_at_three(task, **settings):
    if task == 3:
        raise ZeroDivisionError("no third task")
    return draws(task, **settings)


def test_an_error_of_a_task_is_raised_and_results_before_it_are_kept(tmp_path):
    with pytest.raises(ZeroDivisionError, match="no third task"):
        study.run(fails_at_three, TASKS, SETTINGS, tmp_path)
    assert len(files(tmp_path)) == 1 + 3  # with the settings


def test_an_error_on_a_worker_is_raised_here(tmp_path):
    with study.workers(1) as client, pytest.raises(ZeroDivisionError, match="no third task"):
        study.run(fails_at_three, TASKS, SETTINGS, tmp_path, client)


def surroundings(task):
    return torch.tensor([torch.get_num_threads(), torch.get_default_dtype().itemsize])


def test_a_task_runs_on_one_thread_in_float64_and_puts_both_back(tmp_path):
    threads, dtype = torch.get_num_threads(), torch.get_default_dtype()
    try:
        torch.set_num_threads(2)
        torch.set_default_dtype(torch.float32)
        [found] = study.run(surroundings, [0], {}, tmp_path)
        assert (torch.get_num_threads(), torch.get_default_dtype()) == (2, torch.float32)
    finally:
        torch.set_num_threads(threads)
        torch.set_default_dtype(dtype)
    assert found.tolist() == [1, 8]


def test_workers_elsewhere_are_used_by_their_address_and_go_on(tmp_path):
    with study.workers(1) as there:
        address = there.scheduler.address
        assert address.startswith("tcp://127.0.0.1:")
        with study.workers(address=address) as client:
            results = study.run(draws, TASKS, SETTINGS, tmp_path, client)
        assert len(there.run(os.getpid)) == 1
    assert all(same(results, expected()))
