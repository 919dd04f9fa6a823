"""Derivatives of a function that maps every member of a batch by itself, all in one call.

Reverse mode gives one row of every member's Jacobian in a backward pass. So the batch is copied
once for each row, and one pass over the copies gives them all. Inside torch's transforms and
while it compiles, where a backward pass cannot be asked for, ``torch.func`` does the same.
"""

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from .batched import cat, inside_transform, settled

FEW = 100  # rows of a batch, for which fewer calls save more time than less arithmetic


def jacobians(function: Callable, x: Tensor, u: Tensor, wrt: str = "xu") -> tuple[Tensor, ...]:
    """Returns ``y = function(x, u) (..., p)``, ``dy/dx (..., p, n)`` and ``dy/du (..., p, m)``.

    They are differentiable where y is.

    Args:
        function: maps ``(..., n), (..., m)`` to ``(..., p)``.
        x: ``(..., n)``.
        u: ``(..., m)``, of the same batch.
        wrt: ``"x"`` leaves out the last result.
    """
    if inside_transform(x):
        return _transformed(function, x, u, wrt)
    y = function(x, u)
    if y.shape[:-1] != x.shape[:-1]:  # parameters have a batch of their own
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))
    graph, p = y.requires_grad, y.shape[-1]
    with torch.enable_grad():
        copies = [_copies(z, p, graph) for z in (x, u)]
        rows = function(*copies)
        given = copies if wrt == "xu" else copies[:1]
        J = _pull_back(rows, given, _unit_rows(y), graph)
    return (y, *(j.movedim(0, -2) for j in J))


def taylor(function: Callable, x: Tensor, u: Tensor) -> tuple[Tensor, Tensor, Tensor, Callable]:
    """Returns y, ``dy/dx`` and ``dy/du`` as :func:`jacobians` does, and the second derivative.

    That is a function of weights ``(..., n)``: :func:`hessian` of them. For a few rows it goes on
    where the Jacobians ended, from copies enough for both. Nothing carries a graph, and y has the
    size of x.
    """
    n, k = x.shape[-1], x.shape[-1] + u.shape[-1]
    if inside_transform(x) or x.numel() > FEW * n:
        with torch.no_grad():
            y, A, B = jacobians(function, x, u)
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))
        return y, A, B, partial(hessian, function, x, u)
    with torch.no_grad():
        y = function(x, u)
    x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))  # parameters have a batch of their own
    with torch.enable_grad():
        copies = [_copies(z.expand(n, *z.shape), k, False) for z in (x, u)]
        rows = function(*copies)
        J = torch.cat(_pull_back(rows, copies, _unit_rows(y).expand_as(rows), True), -1)

    def curve(weights: Tensor) -> Tensor:
        unit = torch.eye(k, dtype=x.dtype, device=x.device).reshape(k, *[1] * x.ndim, k)
        H = _pull_back(J, copies, weights.movedim(-1, 0).unsqueeze(-1) * unit, False)
        return torch.cat(H, -1).sum(1).movedim(0, -2)

    slopes = J[0].detach().movedim(0, -2)
    return y, slopes[..., :n], slopes[..., n:], curve


def hessian(function: Callable, x: Tensor, u: Tensor, weights: Tensor) -> Tensor:
    """Returns the second derivative of ``weights' function(x, u)``, ``(..., n+m, n+m)``.

    It carries no graph.
    """

    def slope(x, u):
        return cat(torch.func.vjp(function, x, u)[1](weights), -1, 1)

    if inside_transform(x):
        return cat(_transformed(slope, x, u, "xu")[1:], -1)
    with torch.enable_grad():
        copies = [_copies(z, x.shape[-1] + u.shape[-1], False) for z in (x, u)]
        y = function(*copies)
        g = torch.cat(_pull_back(y, copies, weights.expand_as(y), True), dim=-1)
        H = torch.cat(_pull_back(g, copies, _unit_rows(g[0]), False), dim=-1)
    return H.movedim(0, -2)


def _copies(z: Tensor, count: int, graph: bool) -> Tensor:
    """Returns count copies of z that can be differentiated by."""
    z = z.expand(count, *z.shape)
    return z if graph and z.requires_grad else z.detach().requires_grad_()


def _unit_rows(y: Tensor) -> Tensor:
    """Returns ``(p, ..., p)``: for each copy of the batch the unit vector of its row."""
    p = y.shape[-1]
    eye = torch.eye(p, dtype=y.dtype, device=y.device)
    return eye.reshape(p, *[1] * (y.ndim - 1), p).expand(p, *y.shape)


def _pull_back(y: Tensor, given: list[Tensor], v: Tensor, graph: bool) -> tuple[Tensor, ...]:
    if not y.requires_grad:
        return tuple(torch.zeros_like(z) for z in given)
    return torch.autograd.grad(y, given, v, create_graph=graph, materialize_grads=True)


def _transformed(function: Callable, x: Tensor, u: Tensor, wrt: str) -> tuple[Tensor, ...]:
    if wrt == "xu":
        y, pull = torch.func.vjp(function, x, u)[:2]
    else:
        y, pull = torch.func.vjp(lambda x: function(x, u), x)[:2]
    if y.shape[:-1] != x.shape[:-1]:
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))
        return _transformed(function, x, u, wrt)
    return (y, *(settled(j.movedim(0, -2), 2) for j in torch.vmap(pull)(_unit_rows(y))))
