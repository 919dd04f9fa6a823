"""The same plan by other tools: its record, and the programs that made it."""

import importlib.util
import json
import subprocess
import sys

import pytest
import torch
from oracles import close

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import other_tools
from pypose_lite.teaching.other_tools import __main__ as runner

PROGRAMS = runner.HERE / "programs"


def ours():
    weights = torch.diag(torch.tensor([1, 1, 0.3, 0.3, 0.01, 0.01], dtype=torch.float64))
    start, target = infinity.waypoints(torch.float64)[:2]
    bounds = {"u_lower": torch.tensor([0.0, -4.0]), "u_upper": torch.tensor([2.0, 4.0])}
    bounds = {name: bound.double() for name, bound in bounds.items()}
    return pp.MPC(pp.DubinsCar(0.1), weights, None, 10)(0.1, start, target, **bounds)


@pytest.fixture
def problem(monkeypatch):
    monkeypatch.syspath_prepend(str(PROGRAMS))
    monkeypatch.delitem(sys.modules, "problem", raising=False)
    return importlib.import_module("problem")


def test_the_record_has_an_answer_of_each_program():
    answers = other_tools.record()["answers"]
    assert [answer["program"] for answer in answers] == list(runner.PROGRAMS)
    used = {program.split()[0] for program in runner.PROGRAMS}
    assert used | {"problem.py"} == {path.name for path in PROGRAMS.glob("*.py")}


def test_the_problem_of_the_programs_is_that_of_the_book(problem):
    x, u, cost = ours()
    start, second = infinity.waypoints(torch.float64)[:2]
    close(torch.tensor(problem.START, dtype=torch.float64), start, 1e-12)
    close(torch.tensor(problem.TARGET, dtype=torch.float64), second, 1e-12)
    assert problem.cost(u.tolist()) == pytest.approx(cost.item(), abs=1e-12)


def test_a_plan_is_reported_with_its_first_input_cost_and_time(problem, capsys):
    problem.report("a tool", "1.0", lambda: [[1.0, 0.5]] * problem.T)
    found = json.loads(capsys.readouterr().out)
    assert found["u0"] == [1.0, 0.5] and found["ms"] > 0
    assert found["cost"] == pytest.approx(problem.cost([[1.0, 0.5]] * problem.T))


@pytest.mark.parametrize("program", ["ours.py", "casadi_.py ipopt", "casadi_.py fatrop"])
def test_a_program_answers_what_is_recorded(program):
    if "casadi" in program and not importlib.util.find_spec("casadi"):
        pytest.skip("CasADi is not installed")
    recorded = {answer["program"]: answer for answer in other_tools.record()["answers"]}[program]
    found = runner.answer(program, sys.executable)
    assert found["u0"] == pytest.approx(recorded["u0"], abs=1e-6)
    assert found["u0"] == pytest.approx(ours()[1][0].tolist(), abs=1e-6)


def test_a_program_that_fails_is_named_with_its_error(monkeypatch):
    done = subprocess.CompletedProcess([], 1, "", "Traceback\nModuleNotFoundError: no tool")
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: done)
    with pytest.raises(SystemExit, match="ours.py failed: ModuleNotFoundError: no tool"):
        runner.answer("ours.py", sys.executable)


def test_programs_are_shown_as_code():
    text = other_tools.program("casadi_.py").data
    assert text.startswith("```python\n") and "opti.minimize(cost)" in text
