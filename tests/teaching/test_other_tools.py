"""The same plan by other tools: its record, and the programs that made it."""

import importlib.util
import json
import subprocess
import sys
import types

import pytest
import torch
from oracles import close

import pypose_lite as pp
from pypose_lite import infinity
from pypose_lite.teaching import other_tools
from pypose_lite.teaching.other_tools import __main__ as runner
from pypose_lite.teaching.other_tools import both as beside

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


# --- PyPose beside this library


def doubled(pp):
    return {"name": pp.__name__, "numbers": [2 * torch.ones(2), 1.5]}


def broken(pp):
    raise ValueError("no such thing\nin two lines")


@pytest.fixture
def without_pypose(monkeypatch, tmp_path):
    monkeypatch.setattr(beside, "installed", lambda: False)
    monkeypatch.setattr(beside, "RECORD", tmp_path / "pypose.json")
    return tmp_path / "pypose.json"


def entry(example, answer):
    return {example.__name__: {"text": beside._text(example), "answer": answer}}


def test_without_pypose_its_answer_is_the_recorded_one(without_pypose):
    record = {"version": "0.9.5", "answers": entry(doubled, [1, 2])}
    without_pypose.write_text(json.dumps(record), encoding="utf-8")
    answers = beside.both(doubled)
    assert answers.ours == {"name": "pypose_lite", "numbers": [[2.0, 2.0], 1.5]}
    assert answers.theirs == [1, 2]
    assert "recorded with version 0.9.5" in beside.provenance()


def test_an_error_is_an_answer(without_pypose):
    record = {"version": "0.9.5", "answers": entry(broken, 0)}
    without_pypose.write_text(json.dumps(record), encoding="utf-8")
    assert beside.both(broken).ours == "ValueError: no such thing"


def test_an_answer_to_another_text_is_refused(without_pypose):
    answers = entry(doubled, [1, 2])
    answers["doubled"]["text"] = "another"
    record = {"version": "0.9.5", "answers": answers}
    without_pypose.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(RuntimeError, match="doubled: .*another text.*make other-tools"):
        beside.both(doubled)


def test_an_answer_that_was_never_recorded_is_refused(without_pypose):
    with pytest.raises(RuntimeError, match="doubled: .*not recorded.*make other-tools"):
        beside.both(doubled)


def test_the_text_of_an_example_includes_the_functions_that_it_calls():
    def helper(pp):
        return 1

    scope = {"helper": helper}
    one = types.FunctionType(calls_helper.__code__, scope, "calls_helper")
    scope_two = {"helper": doubled}
    two = types.FunctionType(calls_helper.__code__, scope_two, "calls_helper")
    assert beside._text(one) != beside._text(two)


def calls_helper(pp):
    return helper(pp)  # noqa: F821


def test_a_recording_is_written_down(monkeypatch, tmp_path):
    monkeypatch.setattr(beside, "RECORD", tmp_path / "pypose.json")
    monkeypatch.setattr(beside, "installed", lambda: True)
    monkeypatch.setitem(sys.modules, "pypose", types.SimpleNamespace(__version__="1", __name__="p"))
    monkeypatch.setenv(beside.RECORDING, "1")
    beside.both(doubled)
    record = json.loads(beside.RECORD.read_text(encoding="utf-8"))
    assert record["version"] == "1"
    assert record["answers"]["doubled"]["answer"]["name"] == "p"
