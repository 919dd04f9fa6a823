"""Iterative LQR: sweeps, repeated until the next one would change nothing.

`MPC` and the bounded `LQR` call :func:`optimize`. It rolls the first inputs out, sweeps
(`sweep.py`), judges each sweep (`verdict.py`) and ends when every plan of a batch has converged,
or after 200 sweeps. The cost never rises on the way. `gradient.py` differentiates what comes out.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from ..shapes import inside_transform
from .iterate import Iterate, Solution
from .problem import Problem, refuse_divergence, rollout
from .sweep import choose, priced, regulated, sweep
from .verdict import at_same_bounds, input_curvature, judge

SWEEPS = 200  # at most
EXPLODED = 100  # how many times larger than the first and the wanted states a rollout may become


def improve(problem: Problem, at: Iterate, newton: bool) -> Iterate:
    """Returns the next iterate: one sweep, and the verdict on it."""
    at = at if newton else at._replace(exact=torch.zeros_like(at.exact))
    new = sweep(problem, at, newton)
    same_bounds = at_same_bounds(problem, at.U, new.U)
    return judge(at, new, input_curvature(problem), same_bounds)


@torch.no_grad()
def optimize(
    problem: Problem, x_init: Tensor, U: Tensor, stepper=None, improve: Callable = improve
) -> Solution:
    """Returns the plan that sweeps from U lead to.

    Members of a batch ``(B,)`` that have converged take part no more.

    Args:
        problem: its tensors have a batch dimension for each of the plan's.
        x_init: ``(..., n)``.
        U: inputs to start from, ``(T, ..., m)``.
        stepper: may stop earlier; it is told how much cost the latest sweep hoped to gain.
        improve: :func:`improve`, or a compiled form of it.

    Raises:
        ValueError: where the rollout of U diverges, and the regulator cannot prevent it.
    """
    flat = flattened(problem, x_init, U)
    if flat is not None:
        return optimize(*flat, stepper, improve).shaped(U.shape[1:-1])
    at = start(problem, x_init, U)
    history = [at.cost]
    for _ in range(SWEEPS):
        at = advance(improve, problem, at)
        history.append(at.cost)
        if stepper is not None:
            stepper.step(torch.where(at.converged, 0, at.promised))
        if at.converged.all() or (stepper is not None and not stepper.continual()):
            break
    return Solution(at.X, at.U, at.K, at.cost, at.converged, at.iterations, torch.stack(history))


def start(problem: Problem, x_init: Tensor, U: Tensor) -> Iterate:
    """Returns the rollout of U, kept within its bounds.

    Where that explodes, as on an unstable system it may, the linear regulator drives instead if
    that costs less: from states a hundred times too large no bounded input leads back.
    """
    U = problem.clamp(U)
    X, U, cost = priced(problem, rollout(problem, x_init, U), U)
    if inside_transform(cost):
        raise RuntimeError(
            "sweeps of a plan cannot run inside torch.vmap or torch.func.grad: pass the batch "
            "itself, and differentiate by torch.autograd"
        )
    wanted = problem.r[..., : x_init.shape[-1]].abs().amax((0, -1))
    usual = torch.maximum(x_init.abs().amax(-1), wanted)
    exploded = ~(X.abs().amax((0, -1)) <= EXPLODED * usual)
    if exploded.any():
        new = priced(problem, *regulated(problem, x_init, U))
        X, U, cost = choose(exploded & (new[2] < cost), new, (X, U, cost))
        refuse_divergence(X, cost)
    return Iterate.first(X, U, cost)


def advance(improve: Callable, problem: Problem, at: Iterate) -> Iterate:
    """Returns the next iterate of the members that have not converged; the others stay.

    In a batch ``(B,)`` of separable members the others cost nothing, either.
    """
    left = ~at.converged
    newton = bool((at.exact & left).any())
    if left.all():
        return improve(problem, at, newton)
    if not separable(problem, at.X[0], at.U[0]):
        return at.unless(at.converged, improve(problem, at, newton))
    rows = left.nonzero()[:, 0]
    rows = rows.expand(2) if len(rows) == 1 else rows  # so that a batch remains a batch
    return at.replaced(rows, improve(problem.members(rows), at.members(rows), newton))


def separable(problem: Problem, x: Tensor, u: Tensor) -> bool:
    """Returns whether members of a batch can be planned for without the others.

    They cannot where the system's parameters have a batch of their own.
    """
    one = (z.reshape(-1, z.shape[-1])[0] for z in (x, u))
    return problem.system.transition(*one).ndim == 1


def flattened(problem: Problem, x_init: Tensor, U: Tensor) -> tuple[Problem, Tensor, Tensor] | None:
    """Flattens a batch of any shape to ``(B,)``, and drops it where it has one member.

    Returns None where there is nothing to change, or the system's own batch forbids it.
    """
    batch = U.shape[1:-1]
    flat = () if batch.numel() == 1 else (batch.numel(),)
    if len(batch) == len(flat) or not U.numel() or not separable(problem, x_init, U[0]):
        return None

    def flatten(z: Tensor) -> Tensor:
        own, core = z.shape[1 : 1 + len(batch)], z.shape[1 + len(batch) :]
        if own.numel() == 1:  # shared by all
            return z.reshape(len(z), *[1] * len(flat), *core)
        return z.expand(len(z), *batch, *core).reshape(len(z), *flat, *core)

    tensors = [z if z is None else flatten(z) for z in problem[2:]]
    problem = Problem(*problem[:2], *tensors)  # type: ignore[arg-type]
    return problem, flatten(x_init[None])[0], flatten(U)
