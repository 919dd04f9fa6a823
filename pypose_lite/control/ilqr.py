"""Iterative LQR: sweeps of `sweeps.py`, repeated until the next one would change nothing.

Sequences have time first, ``(T, ..., n)``. `implicit.py` differentiates what comes out.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from .problem import Problem, rollout
from .sweep import search, sweep

SWEEPS = 200  # at most
NEAR = 0.03  # a change of u that leads to where Newton's model should have a minimum


class Solution(NamedTuple):
    """A plan ``X (T+1, ..., n)``, ``U (T, ..., m)``, and how it was found."""

    X: Tensor
    U: Tensor
    cost: Tensor  # (...)
    converged: Tensor  # (...), bool
    iterations: Tensor  # (...), how many sweeps
    history: Tensor  # (sweeps + 1, ...), the cost at the start and after each

    def shaped(self, batch: tuple[int, ...]) -> "Solution":
        """Returns a plan, or a batch ``(B,)`` of them, as a batch of that shape."""
        dims, old = (1, 1, 0, 0, 0, 1), self.cost.ndim
        shapes = ((*z.shape[:d], *batch, *z.shape[d + old :]) for d, z in zip(dims, self))
        return Solution(*(z.reshape(shape) for z, shape in zip(self, shapes)))


DIMS = (1, 1, 0, 0, 0, 0, 0, 0, 0)  # where each part of an iterate has its batch


class Iterate(NamedTuple):
    """Where the iteration stands; X and U have time first, the others are ``(...)``."""

    X: Tensor
    U: Tensor
    cost: Tensor
    promised: Tensor  # what the latest sweep hoped to gain, >= 0; inf: its model had no minimum
    size: Tensor  # of the latest step that was proposed, relative to U
    damping: Tensor
    exact: Tensor  # whether the next sweep may use the exact curvature
    converged: Tensor
    iterations: Tensor

    def members(self, rows: Tensor | slice) -> "Iterate":
        """Returns some members of a batch ``(B,)``."""
        return Iterate(self.X[:, rows], self.U[:, rows], *(z[rows] for z in self[2:]))

    @staticmethod
    def joined(parts: list["Iterate"]) -> "Iterate":
        """Returns batches ``(B,)`` as one."""
        return Iterate(*(torch.cat(zs, d) for d, zs in zip(DIMS, zip(*parts))))

    def replaced(self, rows: Tensor, new: "Iterate") -> "Iterate":
        """Returns this batch with some members replaced."""
        return Iterate(*(z.index_copy(d, rows, w) for d, z, w in zip(DIMS, self, new)))

    def unless(self, done: Tensor, new: "Iterate") -> "Iterate":
        """Returns the new members, where the old ones are not done."""
        masks = (done[..., None], done[..., None], *[done] * len(self[2:]))
        return Iterate(*(torch.where(d, z, w) for d, z, w in zip(masks, self, new)))


def improve(problem: Problem, at: Iterate, newton: bool, step: Tensor | None = None) -> Iterate:
    """Returns the next iterate: one sweep, one search, and what follows from how they went.

    With ``step (...)`` the search tries only that length.
    """
    m, exact = at.U.shape[-1], at.exact if newton else torch.zeros_like(at.exact)
    K, gain, failed = sweep(problem, at.X, at.U, at.damping, exact if newton else None)
    K, gain = torch.where(failed[..., None, None], 0, K), torch.where(failed, 0, gain)  # stays
    X, U, cost, helped = search(problem, at.X, at.U, at.cost, K, gain)
    size = K[..., -1].abs().amax((0, -1)) / (1 + at.U.abs().amax((0, -1)))
    unit = torch.diagonal(problem.Q[..., :m, :m], 0, -2, -1).mean((0, -1))
    old, same = (at.cost, at.size, at.damping, exact), same_bounds(problem, at.U, U)
    promised, size, damping, exact, converged = judge(
        *old, cost, gain, failed, helped, size, unit, same
    )
    count = at.iterations + 1
    return Iterate(X, U, cost, promised, size, damping, exact, converged, count)


def judge(was, last, damping, exact, cost, gain, failed, helped, size, unit, same) -> tuple:
    """Returns what an iterate says of the sweep that led there: ``promised`` to ``converged``.

    The share of its promise that a sweep kept says how far to trust the next one: damping grows
    tenfold below a quarter and shrinks above three. Newton's curvature is tried where
    Gauss-Newton's misled, and near the solution (changes below a quarter), where it ends quickly.
    A sweep whose model has no minimum changes nothing: Gauss-Newton's comes next, or, near the
    solution, where that could take a hundred sweeps, Newton's with more damping.

    A plan has converged when its next step would be too small to matter. Newton's steps shrink
    quadratically, each to some constant times the square of the one before: a sweep that kept its
    promise foretells the next step, and where that is small saves it.

    Args:
        eps: what numbers are rounded to.
        was: the cost of the iterate before.
        last: the size of the step that led there.
        damping: its damping.
        exact: whether the model was Newton's.
        cost: of the new plan.
        gain: what the sweep promised, <= 0.
        failed: whether its model had no minimum.
        helped: whether the search found a better plan.
        size: of the step that the sweep proposed.
        unit: the cost's own curvature in u, to compare damping with.
        same: whether the same inputs stand at a bound as before.
    """
    eps = torch.finfo(cost.dtype).eps
    rounding = 8 * eps * abs(was)
    kept = (was - cost) / (-gain).clip(min=eps**2)
    at_rest = (size <= eps**0.5) | (~helped & (-gain <= rounding))
    as_promised = helped & (abs(was + gain - cost) <= -0.1 * gain + rounding)
    next_size = size**2 * (size / last.clip(min=eps) ** 2).clip(min=1)
    arrives = exact & (damping == 0) & as_promised & same & (next_size <= eps**0.6)
    lowered = torch.where(damping > 1e-6 * unit, damping / 10, 0)
    raised = torch.where(damping > 1e-4 * unit, 10 * damping, 1e-3 * unit)
    near = last < NEAR
    misled = ((kept < 0.25) & (size > eps**0.5)) | (failed & (near | ~exact))
    steady = ((kept > 0.75) | at_rest) & ~failed
    damped = torch.where(misled, raised, torch.where(steady, lowered, damping))
    newton = torch.where(failed, near, (kept < 0.8) | (size < 0.25))
    converged = (at_rest | arrives) & ~failed & (damping <= unit)
    return (
        torch.where(failed, math.inf, -gain),
        torch.where(failed, last, size),
        damped,
        newton,
        converged,
    )


def same_bounds(problem: Problem, U: Tensor, new: Tensor) -> Tensor:
    """Returns whether the same inputs stand at a bound; one that meets it turns the next step."""
    limits = problem.limits(U)
    if limits is None:
        return torch.ones_like(U[0, ..., 0], dtype=torch.bool)
    lower, upper = limits
    same = ((U <= lower) == (new <= lower)) & ((U >= upper) == (new >= upper))
    return same.all(-1).all(0)


def advance(step: Callable, problem: Problem, at: Iterate, which: Tensor, newton: bool) -> Iterate:
    """Returns the next iterate of some members; the others stay, and cost nothing in a ``(B,)``."""
    if which.all():
        return step(problem, at, newton)
    if not apart(problem, at.X[0], at.U[0]):
        return at.unless(~which, step(problem, at, newton))
    rows = which.nonzero()[:, 0]
    rows = rows.expand(2) if len(rows) == 1 else rows  # one is another kind of batch to a compiler
    return at.replaced(rows, step(problem.members(rows), at.members(rows), newton))


def apart(problem: Problem, x: Tensor, u: Tensor) -> bool:
    """Returns whether members of a batch can be swept without the others.

    They cannot where the system has a batch of its own.
    """
    one = (z.reshape(-1, z.shape[-1])[0] for z in (x, u))
    return problem.system.transition(*one).ndim == 1


def in_line(problem: Problem, x_init: Tensor, U: Tensor) -> tuple[Problem, Tensor, Tensor] | None:
    """Returns the same plans as one plan, where there is no other, or as a batch ``(B,)``.

    One plan takes less time than a batch of it. None, where nothing is to change or can be.
    """
    batch = U.shape[1:-1]
    line = () if batch.numel() == 1 else (batch.numel(),)
    if len(batch) == len(line) or not U.numel() or not apart(problem, x_init, U[0]):
        return None

    def flat(z: Tensor) -> Tensor:
        own, core = z.shape[1 : 1 + len(batch)], z.shape[1 + len(batch) :]
        if own.numel() == 1:  # shared by all
            return z.reshape(len(z), *[1] * len(line), *core)
        return z.expand(len(z), *batch, *core).reshape(len(z), *line, *core)

    tensors = [z if z is None else flat(z) for z in problem[2:]]
    problem = Problem(*problem[:2], *tensors)  # type: ignore[arg-type]
    return problem, flat(x_init[None])[0], flat(U)


@torch.no_grad()
def optimize(
    problem: Problem, x_init: Tensor, U: Tensor, stepper=None, step: Callable = improve
) -> Solution:
    """Returns the plan that sweeps from U lead to; its cost never rises on the way.

    Members of a batch ``(B,)`` that have converged take part no more.

    Args:
        problem: its tensors have the batch of x_init and U.
        x_init: ``(..., n)``.
        U: inputs to start from, ``(T, ..., m)``.
        stepper: may stop earlier; it is told how much cost the latest sweep hoped to gain.
        step: :func:`improve`, or a compiled form of it.

    Raises:
        ValueError: where the rollout of U is not finite.
    """
    line = in_line(problem, x_init, U)
    if line is not None:
        return optimize(*line, stepper, step).shaped(U.shape[1:-1])
    at = start(problem, x_init, U)
    history = [at.cost]
    for _ in range(SWEEPS):
        newton = bool((at.exact & ~at.converged).any())
        at = advance(step, problem, at, ~at.converged, newton)
        history.append(at.cost)
        if stepper is not None:
            stepper.step(torch.where(at.converged, 0, at.promised))
        if at.converged.all() or (stepper is not None and not stepper.continual()):
            break
    return Solution(at.X, at.U, at.cost, at.converged, at.iterations, torch.stack(history))


def start(problem: Problem, x_init: Tensor, U: Tensor) -> Iterate:
    """Returns the rollout of U, kept within its bounds; ValueError where that is not finite."""
    U = problem.clip(U)
    X = rollout(problem, x_init, U)
    cost = problem.cost(X, U)
    refuse_divergence(X, cost)
    return first(X, U, cost)


def first(X: Tensor, U: Tensor, cost: Tensor) -> Iterate:
    """Returns an iterate that no sweep has led to."""
    no, none = torch.zeros_like(cost, dtype=torch.bool), torch.zeros_like(cost)
    count = torch.zeros_like(cost, dtype=torch.int64)
    return Iterate(X, U, cost, none, none + torch.inf, none, no, no, count)


def refuse_divergence(X: Tensor, cost: Tensor) -> None:
    """Raises ValueError where states ``(T+1, ..., n)`` or their cost are not finite."""
    if not torch.isfinite(X).all():
        step = int((~torch.isfinite(X)).nonzero()[0, 0])
        raise ValueError(f"x_init: the rollout from it diverges, x[{step}] is not finite")
    if not torch.isfinite(cost).all():
        raise ValueError("x_init: the rollout from it diverges, its cost is not finite")
