"""A study of many tasks, on this machine or on many: its seeds, its workers, its checkpoints.

    with study.workers(2) as client:
        results = study.run(work, range(32), settings, "results", client)

A task is a number, and all that it draws comes from ``generator(seed, task)``. So its result does
not depend on which worker does it, on what was done before, or on how many workers there are. Each
result is written into a folder as soon as it is there, and what is in the folder is not done again.

Workers are those of Dask (https://distributed.dask.org). One that dies is started anew, and its
tasks are done by others. Only the process that calls ``run`` needs the folder.
"""

import json
import logging
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy
import torch
from torch import Tensor


def generator(seed: int, task: int) -> torch.Generator:
    """Returns the generator of a task: another one for each task of a study.

    Args:
        seed: of the whole study, >= 0.
        task: its number, 0 <= task < 2**32.

    Torch's generator keeps only the lower 32 bits of what it is seeded with. Were these drawn at
    random, two of a hundred thousand tasks would probably share theirs; so they are counted, from a
    start that numpy.random.SeedSequence makes of the study's seed. Two studies of N tasks overlap
    with a probability of 2 N / 2**32.
    """
    start = int(numpy.random.SeedSequence(seed).generate_state(1)[0])
    return torch.Generator().manual_seed((start + task) % 2**32)


def run(
    work: Callable[..., Tensor],
    tasks: Iterable[int],
    settings: dict[str, Any],
    folder: str | Path,
    client: Any = None,
    progress: Callable[[int], object] | None = None,
) -> list[Tensor]:
    """Returns the results of all tasks, in their order, and does only those not yet in the folder.

    Args:
        work: called as ``work(task, **settings)``, in any process; returns a tensor.
        tasks: their numbers.
        settings: what the results depend on beside the task, in numbers, strings and lists.
        folder: for the results; it is made where it is missing, and belongs to these settings.
        client: of ``dask.distributed``, as :func:`workers` gives it; None does all tasks here.
        progress: called after each result, with how many of the tasks are done.

    Raises:
        ValueError: the folder holds the results of other settings.
        Exception: whatever ``work`` raises. Results that were there before are kept.
    """
    tasks, folder = list(tasks), Path(folder)
    _claim_folder(folder, settings)
    missing = [task for task in tasks if not _file(folder, task).exists()]
    done = len(tasks) - len(missing)
    for task, result in _results(work, missing, settings, client):
        _write(_file(folder, task), partial(torch.save, result))
        done += 1
        if progress is not None:
            progress(done)
    return [torch.load(_file(folder, task)) for task in tasks]


@contextmanager
def workers(count: int = 2, address: str | None = None) -> Iterator[Any]:
    """Gives a client of Dask, and ends what it has started.

    Args:
        count: processes on this machine, which listen to it alone (127.0.0.1).
        address: of a scheduler that is there already, ``"tcp://10.0.0.5:8786"``; its workers are
            used, on however many machines, and go on afterwards.
    """
    from distributed import Client, LocalCluster

    if address is not None:
        with Client(address) as client:
            yield client
        return
    local = {"host": "127.0.0.1", "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=count, threads_per_worker=1, memory_limit=0, **local) as cluster:
        with Client(cluster) as client:
            yield client


def kill_a_worker(client: Any) -> int:
    """Kills a worker of this machine, as a power cut would; returns its process number."""
    pid = min(client.run(os.getpid).values())
    os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    return pid


def _results(work: Callable, tasks: list[int], settings: dict, client: Any) -> Iterator[tuple]:
    """Pairs of a task and its result, in whichever order they come."""
    if client is None:
        yield from ((task, _on_one_thread(work, task, settings)) for task in tasks)
        return
    from distributed import as_completed

    futures = {
        client.submit(_on_one_thread, work, task, settings, pure=False): task for task in tasks
    }
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        client.cancel(list(futures))


def _on_one_thread(work: Callable, task: int, settings: dict) -> Tensor:
    """A task's result. The number of threads may change the order of a sum, hence its digits."""
    threads, dtype = torch.get_num_threads(), torch.get_default_dtype()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    try:
        return work(task, **settings)
    finally:
        torch.set_num_threads(threads)
        torch.set_default_dtype(dtype)


def _claim_folder(folder: Path, settings: dict) -> None:
    """Writes down whose results a folder holds, or sees to it that they are of these settings."""
    folder.mkdir(parents=True, exist_ok=True)
    file, text = folder / "settings.json", json.dumps(settings, sort_keys=True)
    if not file.exists():
        _write(file, lambda part: part.write_text(text, encoding="utf-8"))
    there = file.read_text(encoding="utf-8")
    if there != text:
        raise ValueError(
            f"folder: expected one for the settings {text}, got {folder} with results of {there}; "
            "a study needs a folder of its own"
        )


def _file(folder: Path, task: int) -> Path:
    return folder / f"task-{task:06d}.pt"


def _write(file: Path, save: Callable[[Path], object]) -> None:
    """Writes a file whole or not at all: under another name first, which is then changed."""
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    save(part)
    part.replace(file)
