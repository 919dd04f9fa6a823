"""Grades a notebook: runs it in a process of its own, and says what its answers are worth."""

import contextlib
import json
import os
import queue
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jupytext
import nbformat

from ..checks import Verdict
from .key import Key, Task, checks_in

WORKER = "pypose_lite.teaching.grading.worker"
START = 120.0  # s until a process is ready, on a busy machine
GRACE = 10.0  # s after which a check that did not end itself is ended
KEPT = (
    *("PATH", "PYTHONPATH", "HOME", "USERPROFILE", "SYSTEMROOT", "TEMP", "TMP", "TMPDIR"),
    *("LANG", "LC_ALL", "LD_LIBRARY_PATH", "OMP_NUM_THREADS", "MPLCONFIGDIR"),
)
ENDED = "It ended the program, as sys.exit and os._exit do."
ENDLESS = "It had not come to an end after {:g} s."


def grade(submission: Any, key: Key) -> list[Verdict]:
    """Returns one verdict for each task of the key, in its order.

    Args:
        submission: a notebook (nbformat), or the path of one, ``.ipynb`` or a jupytext file.
        key: of the lab.

    Raises:
        RuntimeError: the grader itself does not run here, whatever the submission is.
    """
    try:
        cells = cells_of(submission, key)
    except Exception as error:
        what = f"The notebook cannot be read: {type(error).__name__}."
        return [_refused(task, "be in a notebook", what) for task in key.tasks]
    run = _Run(key, cells)
    run.to_the_end()
    return [run.verdicts[task.number] for task in key.tasks]


def cells_of(submission: Any, key: Key) -> list[dict[str, Any]]:
    """Returns the code cells, each with the tasks to judge after it.

    That is where the notebook checks them for the last time; at its end, if it never does.
    """
    if isinstance(submission, str | Path):
        submission = jupytext.read(Path(submission))
    nbformat.validate(submission)
    sources = [cell.source for cell in submission.cells if cell.cell_type == "code"]
    place = {number: k for k, source in enumerate(sources) for number in checks_in(source)}
    cells = [{"source": source, "checks": []} for source in [*sources, ""]]
    for task in key.tasks:
        cells[place.get(task.number, len(sources))]["checks"].append(task.number)
    return cells


class _Run:
    """A submission on its way: processes are started until all tasks are judged.

    A cell or an answer that ends its process, or does not end, costs one; the next process leaves
    it out, so that one of them spoils no other.
    """

    def __init__(self, key: Key, cells: list[dict[str, Any]]) -> None:
        self.key, self.cells = key, cells
        self.tasks = {task.number: task for task in key.tasks}
        self.verdicts: dict[str, Verdict] = {}
        self.ended: dict[int, str] = {}  # cells that are left out, and why
        self.deadline = time.monotonic() + key.seconds

    def to_the_end(self) -> None:
        """Starts processes until each task has its verdict, or the time is over."""
        while (early := self.attempt()) and time.monotonic() < self.deadline:
            what, where, why = early
            if what == "task":
                self.verdicts[where] = _refused(self.tasks[where], "come to an end", why)
            elif what == "cell":
                self.ended[where] = why
        late = f"The notebook had not come to an end after {self.key.seconds:g} s."
        for task in self.key.tasks:
            if task.number not in self.verdicts:
                self.verdicts[task.number] = _refused(task, "be reached in time", late)

    def attempt(self) -> tuple[str, Any, str] | None:
        """Runs a process; returns what it was at when it ended early, and why, or None."""
        word = secrets.token_hex()
        at: tuple[str, Any] = "cell", 0
        with process(self.job(word)) as lines:
            while True:
                seconds = self.limit(*at)
                try:
                    line = lines.get(timeout=min(seconds, self.left()))
                except queue.Empty:
                    return *at, ENDLESS.format(seconds)
                if line is None:
                    return *at, ENDED
                what, value = _heard(line, word)
                if what == "verdict":
                    self.note(*value)
                if what == "done":
                    return None
                at = (what, value) if what else at

    def job(self, word: str) -> str:
        """The job of a process, in JSON."""
        tasks = [asdict(task) for task in self.key.tasks]
        job = {"word": word, "seed": self.key.seed, "tasks": tasks, "cells": self.cells}
        return json.dumps({**job, "ended": self.ended, "judged": [*self.verdicts]})

    def limit(self, what: str, value: Any) -> float:
        """The seconds that a process may take for what it has begun."""
        return self.tasks[value].seconds + GRACE if what == "task" else self.key.cell_seconds

    def left(self) -> float:
        return max(self.deadline - time.monotonic(), 0.01)

    def note(self, number: str, state: str, message: str) -> None:
        """Keeps a verdict; the points are those of the key."""
        task = self.tasks[number]
        points = task.points if state == "accepted" else 0
        self.verdicts[number] = Verdict(number, state, message, points, task.points)


@contextlib.contextmanager
def process(job: str) -> Iterator["queue.Queue[str | None]"]:
    """Starts a worker, and yields the lines that it says, None at their end; then it is ended.

    It sees an empty folder, and of the environment only what a program needs.
    """
    environment = {name: os.environ[name] for name in KEPT if name in os.environ}
    command = [sys.executable, "-P", "-m", WORKER]
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as errors:
        worker = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            cwd=folder,
            env={**environment, "MPLBACKEND": "Agg", "PYTHONUTF8": "1"},
            start_new_session=True,
            encoding="utf-8",
            errors="replace",
        )
        try:
            lines: queue.Queue[str | None] = queue.Queue()
            threading.Thread(target=_listen, args=(worker, job, lines), daemon=True).start()
            if lines.get(timeout=START) is None:  # the first line says that it is ready
                errors.seek(0)
                tail = errors.read().decode("utf-8", "replace").strip()[-500:]
                raise RuntimeError(f"grading: the process that runs submissions fails: {tail}")
            yield lines
        finally:
            _end(worker)


def _listen(worker: subprocess.Popen, job: str, lines: queue.Queue) -> None:
    """Hands the job over, then passes on what the process says."""
    assert worker.stdin and worker.stdout, "both are pipes"
    with contextlib.suppress(OSError):
        worker.stdin.write(job)
        worker.stdin.close()
    for line in worker.stdout:
        lines.put(line)
    lines.put(None)


def _heard(line: str, word: str) -> tuple[str, Any]:
    """What a line says, if it begins with the word that only the worker was told."""
    with contextlib.suppress(ValueError, TypeError):
        first, what, value = json.loads(line)
        if first == word:
            return what, value
    return "", None


def _end(worker: subprocess.Popen) -> None:
    """Ends the process and those that it has started."""
    with contextlib.suppress(ProcessLookupError):
        if hasattr(os, "killpg"):
            os.killpg(worker.pid, signal.SIGKILL)
        else:
            worker.kill()
    worker.wait()


def _refused(task: Task, sentence: str, why: str) -> Verdict:
    message = f"{task.number} {task.title}: it must {sentence}.\n  {why}"
    return Verdict(task.number, "refused", message, 0, task.points, sentence)
