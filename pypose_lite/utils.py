"""PyPose's helper for loops: when to stop."""

import logging
import math

import torch
from torch import Tensor

logger = logging.getLogger(__name__)


class ReduceToBason:
    """Says when a loop may stop: after ``steps``, or when its loss no longer falls.

    Args:
        steps: how many steps at most.
        patience: how many steps in a row may fail to reduce the loss.
        decreasing: the relative reduction that a step has to bring, or it has failed.
        tol: a loss below it is good enough at once.
        verbose: whether each step is logged, by ``logging`` at level INFO.

    Source: PyPose 0.9.5, ``pypose.utils.ReduceToBason``.
    """

    def __init__(self, steps, patience=5, decreasing=1e-3, tol=1e-5, verbose=False):
        self.max_steps, self.patience = steps, patience
        self.decreasing, self.tol, self.verbose = decreasing, tol, verbose
        self.reset()

    def continual(self) -> bool:
        """Returns whether the loop goes on."""
        return self._continual

    def reset(self) -> None:
        """Starts anew."""
        self.steps, self.patience_count, self._continual = 0, 0, True
        self.last: Tensor | float = math.inf

    def step(self, loss: Tensor | float) -> None:
        """Takes note of the loss after one step; all members of a batch must agree to stop."""
        loss = torch.as_tensor(loss).detach()
        self.steps += 1
        stuck = bool(torch.all(self.last - loss < self.decreasing * loss.abs()))
        self.patience_count = self.patience_count + 1 if stuck else 0
        self.last = loss
        good = bool(torch.all(loss < self.tol))
        self._continual = not (
            good or self.steps >= self.max_steps or self.patience_count >= self.patience
        )
        if self.verbose:
            logger.info("step %d: loss %s", self.steps, loss.tolist())
