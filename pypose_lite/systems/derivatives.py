"""Derivatives of a function that maps every member of a batch by itself, all in one call.

Reverse mode gives one row of every member's Jacobian in a backward pass. So the batch is copied
once for each row, and one pass over the copies gives them all.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from ..shapes import inside_transform
from .kinks import nan_for_no_slope


def jacobians(function: Callable, x: Tensor, u: Tensor, wrt: str = "xu") -> tuple[Tensor, ...]:
    """Returns ``y = function(x, u) (..., p)``, ``dy/dx (..., p, n)`` and ``dy/du (..., p, m)``.

    They are differentiable where y is.

    Args:
        function: maps ``(..., n), (..., m)`` to ``(..., p)``.
        x: ``(..., n)``.
        u: ``(..., m)``, of the same batch.
        wrt: ``"x"`` leaves out ``dy/du``.
    """
    y = function(x, u)
    if inside_transform(y):
        return transformed(function, x, u, wrt)
    if y.shape[:-1] != x.shape[:-1]:  # parameters have a batch of their own
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))
    graph, p = y.requires_grad, y.shape[-1]
    with torch.enable_grad():
        copies = [_copies(z, p, graph) for z in (x, u)]
        rows = function(*copies)
        given = copies if wrt == "xu" else copies[:1]
        with nan_for_no_slope(rows, given):
            J = _pull_back(rows, given, _unit_rows(y), graph)
    return (y, *(j.movedim(0, -2) for j in J))


def hessian(function: Callable, x: Tensor, u: Tensor, weights: Tensor) -> Tensor:
    """Returns the second derivative of ``weights' function(x, u)``, ``(..., n+m, n+m)``."""
    if any(inside_transform(z) for z in (x, u, weights)):
        return transformed_hessian(function, x, u, weights)
    with torch.enable_grad():
        copies = [_copies(z, x.shape[-1] + u.shape[-1], False) for z in (x, u)]
        y = function(*copies)
        g = torch.cat(_pull_back(y, copies, weights.expand_as(y), True), dim=-1)
        H = torch.cat(_pull_back(g, copies, _unit_rows(g[0]), False), dim=-1)
    return H.movedim(0, -2)


def _copies(z: Tensor, count: int, graph: bool) -> Tensor:
    """Returns ``(count, ..., n)``: copies of z, by which their images can be differentiated."""
    z = z.expand(count, *z.shape)
    return z if graph and z.requires_grad else z.detach().requires_grad_()


def _unit_rows(y: Tensor) -> Tensor:
    """Returns ``(p, ..., p)``: for each copy of the batch the unit vector of its row."""
    p = y.shape[-1]
    eye = torch.eye(p, dtype=y.dtype, device=y.device)
    return eye.reshape(p, *[1] * (y.ndim - 1), p).expand(p, *y.shape)


def _pull_back(y: Tensor, given: list[Tensor], v: Tensor, graph: bool) -> tuple[Tensor, ...]:
    """Returns v times the Jacobian of y by each given tensor; zeros where y does not depend."""
    if not y.requires_grad:
        return tuple(torch.zeros_like(z) for z in given)
    return torch.autograd.grad(y, given, v, create_graph=graph, materialize_grads=True)


def transformed(function: Callable, x: Tensor, u: Tensor, wrt: str) -> tuple[Tensor, ...]:
    """Returns what :func:`jacobians` does, by ``torch.func``, where y is inside one of these."""
    y, pull = torch.func.vjp(function, x, u)[:2]
    if y.shape[:-1] != x.shape[:-1]:
        x, u = (z.expand(*y.shape[:-1], -1) for z in (x, u))
        return transformed(function, x, u, wrt)
    J = torch.vmap(pull)(_unit_rows(y))[: len(wrt)]
    return (y, *(j.movedim(0, -2) for j in J))


def transformed_hessian(function: Callable, x: Tensor, u: Tensor, weights: Tensor) -> Tensor:
    """Returns what :func:`hessian` does, by ``torch.func``, where x, u or weights are inside it."""

    def slope(x, u):
        return torch.cat(torch.func.vjp(function, x, u)[1](weights), -1)

    return torch.cat(transformed(slope, x, u, "xu")[1:], -1)
