"""What the answers of lab 10 must do: numbers of tasks, and studies that are killed."""

import contextlib
import itertools
import math
import os
import pickle
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from . import expect
from .exercise import Exercise, Failure
from .words import kind

draws = Exercise("10.5", "Numbers for each task", minutes=15, takes="seed, task, n", points=2)


def numbers(answer, seed: int, task: int, n: int = 5) -> Tensor:
    """The numbers of a task, as an answer draws them."""
    return expect.tensor("the numbers", answer(seed, task, n), (n,))


@draws.must("return n standard normal numbers")
def normal(answer, given):
    n = given.size(4000)
    for task in (0, 3):
        z = numbers(answer, 1, task, n)
        mean, spread = z.mean().item(), z.std().item()
        far = abs(mean) > 5 / math.sqrt(n) or abs(spread - 1) > 5 / math.sqrt(2 * n)
        came = f"mean {mean:.2f} and standard deviation {spread:.2f}"
        hint = "torch.randn draws them, torch.rand others."
        expect.that(not far, "mean 0 and standard deviation 1", came, hint)


@draws.must("depend on seed and task alone, and not on what was drawn before")
def repeats(answer, given):
    first = numbers(answer, 2, 5)
    numbers(answer, 2, 6)
    torch.manual_seed(99)
    torch.rand(3)
    hint = "Make a generator of your own, anew in each call."
    expect.that(torch.equal(numbers(answer, 2, 5), first), "the same numbers", "others", hint)


@draws.must("leave the generator of everybody else as it was")
def undisturbed(answer, given):
    torch.manual_seed(7)
    before = torch.get_rng_state()
    numbers(answer, 2, 5)
    same = torch.equal(torch.get_rng_state(), before)
    hint = "torch.manual_seed and torch.randn without a generator change it."
    expect.that(same, "torch's own generator as it was", "it was changed", hint)


def shared(answer, pairs: list[tuple[int, int]]) -> list[tuple]:
    """The pairs of pairs that draw the same numbers."""
    found = {pair: numbers(answer, *pair) for pair in pairs}
    both = itertools.combinations(pairs, 2)
    return [(one, two) for one, two in both if torch.equal(found[one], found[two])]


@draws.must("draw other numbers for each task and each study")
def all_differ(answer, given):
    cases = {
        "Tasks of one study must differ: use the task's number.": [(4, 0), (4, 1), (4, 2)],
        "Studies must differ: use the seed; of 2**32 times a number, torch keeps nothing.": [
            *((0, 4), (1, 4), (2, 4)),
        ],
        "A sum is the same for other pairs.": [(1, 4), (2, 3), (0, 5)],
        "Seed and task may not change places.": [(2, 3), (3, 2)],
        "Digits one after the other are the same for other pairs.": [(1, 23), (12, 3)],
        "There may be more tasks than you leave room for.": [
            *((1, 0), (0, 10), (0, 64), (0, 100), (0, 128), (0, 256), (0, 1000), (0, 1024)),
            *((0, 4096), (0, 10_000), (0, 65_536), (0, 100_000), (0, 1_000_000)),
        ],
    }
    for hint, pairs in cases.items():
        if same := shared(answer, pairs):
            (one, two), *_ = same
            came = f"the same for {one} and {two}"
            raise Failure("other numbers for each pair (seed, task)", came, hint)


resume = Exercise(
    "10.6",
    "A study that was killed",
    minutes=25,
    takes="work, tasks, folder, save, load",
    points=3,
    random=True,
)


class Killed(BaseException):
    """The end of a process, as far as a check can bring it about."""


class Study:
    """Work that counts its calls, in a folder of its own, and that can be killed."""

    def __init__(self, folder: Path, offset: float) -> None:
        self.folder, self.offset = folder, offset
        self.done: list[int] = []
        self.kill_at: int | None = None  # in the work of this task
        self.kill_save: int | None = None  # while this result is being saved, counted from 0
        self.saved = 0

    def work(self, task: int) -> Tensor:
        """The result of a task."""
        if task == self.kill_at:
            raise Killed
        self.done.append(task)
        return torch.tensor([self.offset + task, float(task**2)])

    def save(self, result: Any, path: Any) -> None:
        """Writes a file; if it is killed, half of it."""
        data = pickle.dumps(result)
        killed = self.saved == self.kill_save
        self.saved += 1
        Path(path).write_bytes(data[: len(data) // 2] if killed else data)
        if killed:
            raise Killed

    def load(self, path: Any) -> Any:
        """Reads a file."""
        return pickle.loads(Path(path).read_bytes())

    def call(self, answer, tasks) -> list[Tensor]:
        """The results that an answer gives, compared with the right ones."""
        came = answer(self.work, list(tasks), self.folder, self.save, self.load)
        if not isinstance(came, list | tuple) or len(came) != len(tasks):
            size = f"{kind(came)}"
            raise Failure(f"a list of {len(tasks)} results", size, "One for each of the tasks.")
        for task, result in zip(tasks, came):
            right = torch.tensor([self.offset + task, float(task**2)])
            hint = "Results come in the order of tasks, each from the file of its own task."
            expect.close(f"the result of task {task}", result, right, hint)
        return list(came)

    def is_killed(self, answer, tasks) -> None:
        """Sees to it that a kill goes through."""
        try:
            answer(self.work, list(tasks), self.folder, self.save, self.load)
        except Killed:
            self.kill_at = self.kill_save = None
            return
        hint = "Let it through: a bare `except:` catches even a kill."
        raise Failure("a study that ends when it is killed", "one that went on", hint)


@contextlib.contextmanager
def a_study(given) -> Iterator[Study]:
    """A study in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        yield Study(Path(folder), given.uniform(0, 1).item())


def said(tasks: list[int]) -> str:
    """Tasks in words."""
    return f"tasks {', '.join(map(str, tasks))}" if tasks else "no task"


@resume.must("return the results of all tasks, in their order")
def results_in_order(answer, given):
    with a_study(given) as study:
        study.call(answer, [4, 0, 7, 2])
    with a_study(given) as study:
        study.call(answer, range(5))


@resume.must("do no task again whose result is there")
def nothing_again(answer, given):
    with a_study(given) as study:
        study.call(answer, range(5))
        first = len(study.done)
        expect.that(first == 5, "each task done once", f"{first} calls of work", "")
        study.call(answer, range(5))
        again = study.done[5:]
        hint = "Look for the file of the task before you do its work."
        expect.that(not again, "no work in the second call", said(again), hint)


@resume.must("keep what was done before it was killed")
def killed_at_work(answer, given):
    with a_study(given) as study:
        study.kill_at = 3
        study.is_killed(answer, range(6))
        before = len(study.done)
        study.call(answer, range(6))
        again = study.done[before:]
        hint = "Save each result as soon as it is there."
        expect.that(again == [3, 4, 5], "tasks 3, 4, 5 done after the kill", said(again), hint)


@resume.must("be right after a kill in the middle of saving")
def killed_while_saving(answer, given):
    for number in (0, 2):
        with a_study(given) as study:
            study.kill_save = number
            study.is_killed(answer, range(5))
            hint = "Half of a file was taken for a result: save under another name, then rename."
            try:
                study.call(answer, range(5))
            except (EOFError, pickle.UnpicklingError, ValueError, IndexError) as error:
                came = f"an error when it is read: {type(error).__name__}"
                raise Failure("results of whole files", came, hint) from None


@resume.must("know results by the number of their task, not by its place in the list")
def other_lists(answer, given):
    with a_study(given) as study:
        study.call(answer, range(4))
        before = len(study.done)
        study.call(answer, [9, 2, 0])
        again = study.done[before:]
        hint = "Name the file by the task's number."
        expect.that(again == [9], "task 9 done", said(again), hint)


@resume.must("write into its folder and nowhere else")
def own_folder(answer, given):
    here = set(os.listdir())
    with a_study(given) as study:
        study.call(answer, range(3))
        files = os.listdir(study.folder)
        expect.that(files, "files in the folder", "none", "Paths begin with it: folder / name.")
    expect.that(set(os.listdir()) == here, "nothing outside", "files beside it", "folder / name")
