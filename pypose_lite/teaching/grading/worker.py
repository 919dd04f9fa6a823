"""The process in which one submission runs: ``python -P -m pypose_lite.teaching.grading.worker``.

It reads a job from standard input, runs the cells one after the other, judges the answers where
the notebook has its checks, and says what it begins and what it has found, a line each, to what was
its standard output. Nothing that a cell prints can get there, as cells have another one.
"""

import json
import os
import sys
from collections.abc import Callable
from typing import Any

from IPython.core.interactiveshell import InteractiveShell
from traitlets.config import Config

from .. import checks as first_checks
from .trusted import Trusted

EXIST = "exist after its cells have run"
LONG = 1500  # characters of a verdict


def main() -> None:
    """Does the job."""
    job = json.load(sys.stdin)
    say = speaker(job["word"])
    numbers = [task["number"] for task in job["tasks"]]
    trusted = Trusted({int(number.split(".")[0]) for number in numbers})
    say("ready", None)
    Submission(job, say, trusted).run()
    say("done", None)


def speaker(word: str) -> Callable[[str, Any], None]:
    """Returns what speaks to the process that grades; from now on, nothing else is heard."""
    channel = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nowhere, standard)

    def say(what: str, value: Any) -> None:
        channel.write(json.dumps([word, what, value]) + "\n")
        channel.flush()

    return say


class Submission:
    """The cells of a notebook, and what has become of them."""

    def __init__(self, job: dict[str, Any], say: Callable, trusted: Trusted) -> None:
        self.job, self.say, self.trusted = job, say, trusted
        self.tasks = {task["number"]: task for task in job["tasks"]}
        self.shell = new_shell()
        self.errors: list[str] = []  # since the last check

    def run(self) -> None:
        """Runs each cell, but for those that ended an earlier process, and judges on the way."""
        for index, cell in enumerate(self.job["cells"]):
            if str(index) in self.job["ended"]:
                self.errors.append(self.job["ended"][str(index)])
            else:
                self.say("cell", index)
                self.errors += run_cell(self.shell, cell["source"])
            for number in cell["checks"]:
                self.judge(self.tasks[number])

    def judge(self, task: dict[str, Any]) -> None:
        """Says the verdict on one answer, unless an earlier process has given it."""
        errors, self.errors = self.errors, []
        if task["number"] in self.job["judged"]:
            return
        self.say("task", task["number"])
        checks = self.trusted.restore()
        verdict = verdict_on(task, self.shell.user_ns, self.job["seed"], errors, checks)
        self.say("verdict", [task["number"], verdict.state, verdict.message[:LONG]])


class Shell(InteractiveShell):
    """Runs cells as a notebook does, with magics, and without a window."""

    def enable_gui(self, gui: str | None = None) -> None:
        """Nothing: figures are not shown."""


def new_shell() -> InteractiveShell:
    """Returns an IPython that keeps no history."""
    config = Config()
    config.HistoryManager.enabled = False
    shell = Shell.instance(config=config)
    first_checks_are_silent()
    return shell


def first_checks_are_silent() -> None:
    """The notebook's own checks do nothing here: they cost time, and are not believed."""
    from ... import teaching

    for module in (teaching, first_checks):
        for name in ("check", "progress"):
            setattr(module, name, lambda *_, **__: None)


def run_cell(shell: InteractiveShell, source: str) -> list[str]:
    """Runs a cell and returns its error in words, if there is one."""
    result = shell.run_cell(source, store_history=False)
    error = result.error_before_exec or result.error_in_exec
    if error is None:
        return []
    message = " ".join(str(error).split())[:160]
    return [f"{type(error).__name__}: {message}".removesuffix(": ")]


def verdict_on(task: dict, names: dict, seed: int, errors: list[str], checks: Any) -> Any:
    """Returns the verdict on the answer that the cells have left in ``names``."""
    exercise = checks.find(task["number"])
    exercise.seconds = task["seconds"]
    try:
        answer = eval(task["answer"], names)
    except NameError:
        if not errors or any(error.startswith("NotImplementedError") for error in errors):
            return checks.verdict.still_open(exercise)
        return checks.verdict.refused(exercise, EXIST, f"Your cell: {errors[0]}")
    return checks.judge(exercise, answer, seed)


if __name__ == "__main__":
    main()
