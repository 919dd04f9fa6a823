"""The verdict on a sweep: how far to trust the next one, and whether the plan is done.

Called after every sweep, by `ilqr.py` and by the compiled engine alike, so that both end at the
same plan after as many sweeps.
"""

import math

import torch
from torch import Tensor

from .iterate import Iterate
from .problem import Problem
from .sweep import Sweep

NEAR = 0.03  # a change of u that leads to where Newton's model should have a minimum


def judge(before: Iterate, new: Sweep, unit: Tensor, same_bounds: Tensor) -> Iterate:
    """Returns the next iterate: the new plan, and what follows from how the sweep went.

    The share of its promise that a sweep kept says how far to trust the next one: damping grows
    tenfold below a quarter and shrinks above three. Newton's curvature is tried where
    Gauss-Newton's misled, and near the solution (changes below a quarter), where it ends quickly.
    A sweep whose model has no minimum changes nothing: Gauss-Newton's comes next, or, near the
    solution, where that could take a hundred sweeps, Newton's with more damping.

    A plan has converged when its next step would be too small to matter. Newton's steps shrink
    quadratically, each to some constant times the square of the one before: a sweep that kept its
    promise foretells the next step, and where that is small saves it.

    Args:
        before: where the sweep began; its ``exact`` says whether the model was Newton's.
        new: where it has led.
        unit: the cost's own curvature in u, ``(...)``, to compare damping with.
        same_bounds: whether the same inputs stand at a bound as before, ``(...)``.
    """
    eps = torch.finfo(new.cost.dtype).eps
    change, size, failed, damping = new.change, new.size, new.failed, before.damping
    rounding = 8 * eps * before.cost.abs()
    kept = (before.cost - new.cost) / (-change).clip(min=eps**2)
    at_rest = (size <= eps**0.5) | (~new.helped & (-change <= rounding))
    off = (before.cost + change - new.cost).abs()
    as_promised = new.helped & (off <= -0.1 * change + rounding)
    next_size = size**2 * (size / before.size.clip(min=eps) ** 2).clip(min=1)
    arrives = before.exact & (damping == 0) & as_promised & same_bounds & (next_size <= eps**0.6)

    near = before.size < NEAR
    misled = ((kept < 0.25) & (size > eps**0.5)) | (failed & (near | ~before.exact))
    steady = ((kept > 0.75) | at_rest) & ~failed
    raised = torch.where(damping > 1e-4 * unit, 10 * damping, 1e-3 * unit)
    lowered = torch.where(damping > 1e-6 * unit, damping / 10, 0)
    return Iterate(
        new.X,
        new.U,
        new.K,
        new.cost,
        promised=torch.where(failed, math.inf, -change),
        size=torch.where(failed, before.size, size),
        damping=torch.where(misled, raised, torch.where(steady, lowered, damping)),
        exact=torch.where(failed, near, (kept < 0.8) | (size < 0.25)),
        converged=(at_rest | arrives) & ~failed & (damping <= unit),
        iterations=before.iterations + 1,
    )


def input_curvature(problem: Problem) -> Tensor:
    """Returns the mean of the cost's own curvature in u, ``(...)``."""
    n = problem.rf.shape[-1]
    return torch.diagonal(problem.Q[..., n:, n:], 0, -2, -1).mean((0, -1))


def at_same_bounds(problem: Problem, U: Tensor, new: Tensor) -> Tensor:
    """Returns whether the same inputs stand at a bound in both plans, ``(...)``.

    An input that meets a bound turns the next step, which then cannot be foretold.
    """
    bounds = problem.bounds(U)
    if bounds is None:
        return torch.ones_like(U[0, ..., 0], dtype=torch.bool)
    lower, upper = bounds
    same = ((U <= lower) == (new <= lower)) & ((U >= upper) == (new >= upper))
    return same.all(-1).all(0)
