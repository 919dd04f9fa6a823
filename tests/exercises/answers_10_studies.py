"""Answers to lab 10 on the numbers of tasks and on studies, as students give them."""

import hashlib
import os

import numpy as np
import torch
from graders import right, wrong

# --- 10.5


def normal(seed, n):
    return torch.randn(n, generator=torch.Generator().manual_seed(seed))


@right("10.5")
def by_a_seed_sequence(seed, task, n):
    return normal(int(np.random.SeedSequence([seed, task]).generate_state(1)[0]), n)


@right("10.5")
def with_room_between_studies(seed, task, n):
    return normal(seed * 2**20 + task, n)


@right("10.5")
def with_numpy(seed, task, n):
    return np.random.default_rng([seed, task]).standard_normal(n)


@right("10.5")
def by_a_hash(seed, task, n):
    digest = hashlib.sha256(f"{seed}, {task}".encode()).digest()
    return normal(int.from_bytes(digest[:8], "little") >> 1, n)


@wrong("10.5", "it was changed")
def the_generator_of_everybody(seed, task, n):
    torch.manual_seed(seed * 2**20 + task)
    return torch.randn(n)


@wrong("10.5", "give the same result for the same arguments")
def without_a_seed(seed, task, n):
    return torch.randn(n)


@wrong("10.5", "Tasks of one study must differ")
def one_seed_for_all_tasks(seed, task, n):
    return normal(seed, n)


@wrong("10.5", "Studies must differ")
def without_the_studys_seed(seed, task, n):
    return normal(task, n)


@wrong("10.5", "torch keeps nothing")
def more_bits_than_torch_keeps(seed, task, n):
    return normal(seed * 2**32 + task, n)


@wrong("10.5", "A sum is the same")
def the_sum(seed, task, n):
    return normal(seed + task, n)


@wrong("10.5", "may not change places")
def the_product(seed, task, n):
    return normal((seed + 1) * (task + 1), n)


@wrong("10.5", "may not change places")
def the_larger_one_first(seed, task, n):
    return normal(max(seed, task) * 2**16 + min(seed, task), n)


@wrong("10.5", "Digits one after the other")
def the_digits(seed, task, n):
    return normal(int(f"1{seed}{task}"), n)


@wrong("10.5", "leave room for")
def too_little_room(seed, task, n):
    return normal(1000 * seed + task, n)


@wrong("10.5", "torch.randn draws them")
def uniform(seed, task, n):
    return torch.rand(n, generator=torch.Generator().manual_seed(seed * 2**20 + task))


# --- 10.6


def file_of(folder, task):
    return folder / f"result-{task}"


@right("10.6")
def by_renaming(work, tasks, folder, save, load):
    for task in tasks:
        if not file_of(folder, task).exists():
            save(work(task), folder / "part")
            os.replace(folder / "part", file_of(folder, task))
    return [load(file_of(folder, task)) for task in tasks]


@right("10.6")
def with_a_second_file_that_says_so(work, tasks, folder, save, load):
    def done(task):
        return folder / f"{task}.done"

    for task in tasks:
        if not done(task).exists():
            save(work(task), file_of(folder, task))
            done(task).touch()
    return [load(file_of(folder, task)) for task in tasks]


@right("10.6")
def by_trying_to_load(work, tasks, folder, save, load):
    results = []
    for task in tasks:
        try:
            result = load(file_of(folder, task))
        except Exception:
            result = work(task)
            save(result, file_of(folder, task))
        results.append(result)
    return results


@wrong("10.6", "no work in the second call")
def all_of_it_again(work, tasks, folder, save, load):
    for task in tasks:
        save(work(task), file_of(folder, task))
    return [load(file_of(folder, task)) for task in tasks]


@wrong("10.6", "Save each result as soon as it is there")
def all_in_one_file_at_the_end(work, tasks, folder, save, load):
    path = folder / "-".join(map(str, tasks))
    if not path.exists():
        save([work(task) for task in tasks], folder / "part")
        os.replace(folder / "part", path)
    return load(path)


@wrong("10.6", "Half of a file was taken for a result")
def straight_into_the_file(work, tasks, folder, save, load):
    for task in tasks:
        if not file_of(folder, task).exists():
            save(work(task), file_of(folder, task))
    return [load(file_of(folder, task)) for task in tasks]


@wrong("10.6", "a bare `except:`")
def that_cannot_be_killed(work, tasks, folder, save, load):
    results = []
    for task in tasks:
        path = file_of(folder, task)
        try:
            if not path.exists():
                save(work(task), folder / "part")
                os.replace(folder / "part", path)
            results.append(load(path))
        except:  # noqa: E722
            pass
    return results


@wrong("10.6", "each from the file of its own task")
def named_by_the_place(work, tasks, folder, save, load):
    for k, task in enumerate(tasks):
        if not file_of(folder, k).exists():
            save(work(task), folder / "part")
            os.replace(folder / "part", file_of(folder, k))
    return [load(file_of(folder, k)) for k in range(len(tasks))]


@wrong("10.6", "Results come in the order of tasks")
def in_the_order_of_their_numbers(work, tasks, folder, save, load):
    return by_renaming(work, sorted(tasks), folder, save, load)


@wrong("10.6", "a list of 4 results")
def the_last_one(work, tasks, folder, save, load):
    return by_renaming(work, tasks, folder, save, load)[-1]
