"""A check ends, prints its verdict alone, and puts back what an answer changes."""

import builtins
import os
import random
import signal
import subprocess
import sys
import time
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

from pypose_lite.teaching import checks
from pypose_lite.teaching.checks import judge


def right(x):
    return x + x


def spin(x):
    while True:
        pass


def doze(x):
    while True:
        time.sleep(0.01)


def deny(x):
    while True:
        try:
            time.sleep(0.01)
        except:  # noqa: E722
            pass


def insist(x):
    while True:
        try:
            spin(x)
        except BaseException:
            continue


def untraced(frame, event, arg):
    """A debugger's, say, which has no interest in the check."""


@pytest.mark.timeout(60)
@pytest.mark.parametrize("answer", [spin, doze, deny, insist])
def test_an_endless_loop_is_ended(double, answer):
    before = sys.gettrace()
    sys.settrace(untraced)
    verdict = judge(double, answer)
    traced = sys.gettrace()
    sys.settrace(before)
    assert verdict.state == "refused"
    assert "Your code had not come to an end after 0.5 s." in str(verdict)
    assert traced is untraced
    time.sleep(0.5)  # no second exception arrives


def test_a_time_limit_that_is_not_reached_leaves_nothing_behind(double):
    double.seconds = 0.2
    for _ in range(20):
        assert judge(double, right).passed
    time.sleep(0.4)


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_readers_own_interrupt_stops_the_check():
    code = (
        "from pypose_lite.teaching.checks import Exercise, judge\n"
        "e = Exercise('98.1', 'x', minutes=1, seconds=30)\n"
        "@e.must('end')\n"
        "def endless(answer, given):\n"
        "    print('begun', flush=True)\n"
        "    import sys; sys.__stdout__.write('begun\\n'); sys.__stdout__.flush()\n"
        "    while True: pass\n"
        "try: judge(e, 1)\n"
        "except KeyboardInterrupt: print('interrupted', flush=True)\n"
    )
    command = [sys.executable, "-c", code]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60)[0] == "interrupted\n"


# --- what it puts back


def settings():
    """All that an answer may change and nobody else should notice."""
    return {
        "dtype": torch.get_default_dtype(),
        "grad": torch.is_grad_enabled(),
        "torch": torch.get_rng_state().tolist(),
        "numpy": np.random.get_state()[1].tolist(),
        "python": random.getstate(),
        "errors": np.geterr(),
        "filters": list(warnings.filters),
        "figure": plt.rcParams["figure.figsize"],
        "sum": builtins.sum,
        "stdout": sys.stdout,
        "interrupts": signal.getsignal(signal.SIGINT),
    }


def meddle(x):
    torch.set_default_dtype(torch.float16)
    torch.set_grad_enabled(False)
    torch.manual_seed(5), np.random.seed(5), random.seed(5)
    np.seterr(all="raise")
    warnings.simplefilter("error")
    plt.rcParams["figure.figsize"] = (1, 1)
    builtins.sum = builtins.max
    sys.stdout = None
    return 2 * x


def test_what_an_answer_changes_is_put_back(double):
    before = settings()
    judge(double, meddle)
    assert settings() == before


@pytest.mark.parametrize("default", [torch.float32, torch.float64])
def test_a_check_is_the_same_whatever_the_reader_has_set(double, default):
    before = torch.get_default_dtype()
    torch.set_default_dtype(default)
    try:
        with torch.no_grad():
            assert judge(double, lambda x: x @ (2 * torch.eye(3))).passed
    finally:
        torch.set_default_dtype(before)


def test_a_warning_is_no_error_whatever_the_reader_has_set(double):
    with warnings.catch_warnings(), np.errstate(all="warn"):
        warnings.simplefilter("error")
        assert judge(double, lambda x: 2 * x + 0 * float(np.exp(1e9) < 0)).passed


def test_nothing_is_printed_but_the_verdict(double, capfd):
    def loud(x):
        print("hello")
        print("world", file=sys.stderr)
        warnings.warn("careful", stacklevel=1)
        return 2 * x

    checks.check("98.1", loud)
    assert capfd.readouterr() == ("✓ 98.1 Twice as long: accepted.\n", "")


@pytest.mark.timeout(60)
def test_a_flood_of_output_is_dropped(double, capfd):
    double.seconds = 20.0

    def flood(x):
        for _ in range(2000):
            print("x" * 10**5)
        return 2 * x

    assert judge(double, flood).passed
    assert capfd.readouterr().out == ""
