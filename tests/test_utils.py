"""When a loop may stop."""

import logging

import pytest
import torch

from pypose_lite.utils import ReduceToBason


def run(stepper, losses):
    """How many of the losses are taken note of before the loop ends."""
    taken = 0
    for loss in losses:
        if not stepper.continual():
            break
        stepper.step(loss)
        taken += 1
    return taken


def test_a_loop_ends_after_its_steps():
    assert run(ReduceToBason(steps=5), [1 / 2**i for i in range(20)]) == 5


def test_a_loop_ends_when_its_loss_is_good_enough():
    assert run(ReduceToBason(steps=50, tol=0.1), [1, 0.5, 0.2, 0.09, 0.01]) == 4


@pytest.mark.parametrize("sign", [1, -1])
def test_a_loop_ends_after_so_many_failures_in_a_row(sign):
    """A reduction by less than 10 % is a failure, also of a loss below 0."""
    stepper = ReduceToBason(steps=50, patience=2, decreasing=0.1, tol=-1e9)
    falls = [10, 8, 7.9, 6, 5.9, 5.8, 1] if sign > 0 else [-1, -2, -2.1, -4, -4.1, -4.2, -9]
    assert run(stepper, falls) == 6


def test_all_members_of_a_batch_have_to_agree():
    stepper = ReduceToBason(steps=50, patience=1)
    losses = [torch.tensor([1.0, 1.0]), torch.tensor([1.0, 0.5]), torch.tensor([1.0, 0.5])]
    assert run(stepper, losses + losses) == 3
    assert (
        run(ReduceToBason(steps=50, tol=0.1), [torch.tensor([0.01, k]) for k in (1, 0.2, 0)]) == 3
    )


def test_a_reset_starts_anew():
    stepper = ReduceToBason(steps=9, patience=1)
    assert run(stepper, [1.0, 1.0, 1.0]) == 2 and not stepper.continual()
    stepper.reset()
    assert stepper.continual() and run(stepper, [1.0, 1.0, 1.0]) == 2


def test_losses_keep_no_graph_and_are_logged_only_when_asked(caplog):
    caplog.set_level(logging.INFO)
    stepper = ReduceToBason(steps=9)
    stepper.step(torch.tensor(2.0, requires_grad=True) * 3)
    assert not stepper.last.requires_grad and not caplog.records
    ReduceToBason(steps=9, verbose=True).step(0.25)
    assert [record.getMessage() for record in caplog.records] == ["step 1: loss 0.25"]
