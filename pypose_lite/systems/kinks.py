"""The error where a function has a value but no derivative: a root, a norm or an angle at 0.

Left alone, a NaN or an infinity would pass through a covariance or a plan without a word. So would
the zero that torch gives for the slope of ``atan2(0, 0)`` or of a norm at 0: it is made NaN. And so
would the zeros that torch gives for a function that takes its numbers out of torch: they warn.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ..shapes import has_numbers
from .slow import warn_of_lost_slopes

ADVICE = (
    "Roots, powers below 1, norms and angles have no derivative at 0, nor acos at 1. Smooth them, "
    "as (v**2 + 1e-9).sqrt() does, or stay away from there; torch.where does not help unless the "
    "branch that it drops is finite, too"
)
# Where the nodes of torch's graph that answer 0 have no derivative; the names are torch's.
NO_SLOPE: dict[str, Callable] = {
    "Atan2Backward0": lambda node: (node._saved_self == 0) & (node._saved_other == 0),
    "LinalgVectorNormBackward0": lambda node: node._saved_result == 0,
    "DistBackward0": lambda node: node._saved_result == 0,
    "NormBackward1": lambda node: node._saved_result == 0,  # a mapped torch.dist
    "AbsBackward0": lambda node: (node._saved_self == 0) & node._saved_self.is_complex(),
}


@contextmanager
def nan_for_no_slope(y: Tensor, given: Sequence[Tensor]) -> Iterator[None]:
    """Makes gradients of y by some tensors NaN where torch answers 0 for want of a derivative.

    A gradient that does not pass through such a point stays: that of ``v.norm() * v`` at 0 is 0.
    """
    hooks = []
    for node in nodes_between(y, given):
        where = NO_SLOPE[node.name()](node) if node.name() in NO_SLOPE else None
        if where is not None and where.any():

            def spoil(grads, where=where):
                return (grads[0].masked_fill(where & (grads[0] != 0), torch.nan), *grads[1:])

            hooks.append(node.register_prehook(spoil))
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def nodes_between(y: Tensor, given: Sequence[Tensor]) -> Iterator[Any]:
    """Yields the nodes of the graph that leads from the given tensors to y, and no older ones."""
    seen, ahead = {z.grad_fn for z in given}, [y.grad_fn]
    while ahead:
        node = ahead.pop()
        if node is not None and node not in seen:
            seen.add(node)
            yield node
            ahead.extend(before for before, _ in node.next_functions)


class Place(NamedTuple):
    """Whose derivatives they are, and of which time steps: one, or some that fit the batch."""

    system: nn.Module
    name: str
    t: Tensor


def refuse_kinks(place: Place, function: Callable, x, u, y: Tensor, slopes: Tensor) -> None:
    """Raises ValueError where a Jacobian is not finite though the function itself is.

    Warns where all derivatives are 0 though the function moves with x or u. All of it costs a sum
    where all is well. Inside ``torch.vmap`` and while torch compiles, where numbers cannot be asked
    for, nothing is refused.

    Args:
        place: what the error names.
        function: maps x and u to y.
        x: ``(..., n)``.
        u: ``(..., m)``.
        y: ``(..., p)``.
        slopes: the Jacobian by ``[x, u]``, ``(..., p, n+m)``, or by x alone.
    """
    total = slopes.detach().sum().item() if has_numbers(slopes) else 1.0
    if total == 0 and not slopes.any():
        if _moves(_differences(function, x, u, y)[..., : slopes.shape[-1]], y):
            warn_of_lost_slopes(place.system, place.name)
    bad = None if math.isfinite(total) else _bad(slopes, y)
    if bad is not None:
        apart = _spread(_differences(function, x, u, y)[..., : slopes.shape[-1]])
        kinked = torch.where(bad, apart.nan_to_num(torch.inf), -1)
        *member, _, _ = bad.nonzero()[0].tolist()
        i, j = (kinked[tuple(member)] >= kinked[tuple(member)].max() / 2).nonzero()[0].tolist()
        entry = f"d{_letter(place)}[{i}]/d{_component(j, x)}"
        _refuse(place, y, entry, slopes[(*member, i, j)], member)


def refuse_curved_kinks(place: Place, x: Tensor, y: Tensor, H: Tensor) -> None:
    """Raises ValueError where a second derivative is not finite though the function itself is.

    Args:
        place: what the error names.
        x: ``(..., n)``.
        y: the function's values ``(..., p)``.
        H: of a weighted sum of the function's components, by ``[x, u]``, ``(..., n+m, n+m)``.
    """
    bad = _bad(H, y)
    if bad is not None:
        guilty = bad & torch.eye(H.shape[-1], dtype=torch.bool, device=H.device)
        *member, i, j = (guilty if guilty.any() else bad).nonzero()[0].tolist()
        entry = f"d2{_letter(place)}/d{_component(i, x)}d{_component(j, x)}"
        _refuse(place, y, entry, H[(*member, i, j)], member)


def _bad(slopes: Tensor, y: Tensor) -> Tensor | None:
    """Returns which derivatives are not finite though their member's y is; None where none is."""
    if not has_numbers(slopes) or math.isfinite(slopes.detach().sum()):
        return None
    bad = ~slopes.isfinite() & y.isfinite().all(-1)[..., None, None]
    return bad if bad.any() else None


def _moves(found: Tensor, y: Tensor) -> bool:
    """Returns whether slopes by differences agree anywhere on a number that is not 0."""
    size = found.abs().amax(0)
    small = torch.finfo(y.dtype).eps ** 0.25 * (1 + y.detach().abs().unsqueeze(-1))
    return bool(((size > small) & (_spread(found) < size / 2)).any())


@torch.no_grad()
def _differences(function: Callable, x: Tensor, u: Tensor, y: Tensor) -> Tensor:
    """Returns slopes by differences, three for each component by each of z = [x, u].

    They are taken to both sides, and over a shorter step, and disagree where a derivative is
    missing. The derivatives that torch returns say less: one component that has none makes NaN of
    the others', too, as 0 times infinity.
    """
    z, h = torch.cat([x, u], -1).expand(*y.shape[:-1], -1), torch.finfo(y.dtype).eps ** (1 / 3)
    sizes, found = (x.shape[-1], u.shape[-1]), []
    for way in torch.eye(sum(sizes), dtype=z.dtype, device=z.device):
        try:
            moved = [function(*(z + s * way).split(sizes, -1)) for s in (h, -h, h / 8)]
            found.append(torch.stack([(f - y) / s for f, s in zip(moved, (h, -h, h / 8))]))
        except Exception:  # f may have no value there
            found.append(torch.full_like(y, torch.nan).expand(3, *y.shape))
    return torch.stack(found, -1)


def _spread(found: Tensor) -> Tensor:
    return found.amax(0) - found.amin(0)


def _letter(place: Place) -> str:
    return "f" if place.name == "state_transition" else "g"


def _component(j: int, x: Tensor) -> str:
    n = x.shape[-1]
    return f"x[{j}]" if j < n else f"u[{j - n}]"


def _refuse(place: Place, y: Tensor, entry: str, value: Tensor, at: list[int]) -> None:
    """Raises the error; of where it is, the dimensions along which t varies say the time step."""
    lead, t = y.shape[:-1], place.t
    if t.ndim:
        own = (*[1] * (len(lead) - t.ndim), *t.shape)
        t = t.expand(lead)[tuple(at)]
        at = [i for i, size, steps in zip(at, lead, own) if steps != size]
    member = f" in member {tuple(at)} of the batch" if at else ""
    raise ValueError(
        f"{place.name} of {type(place.system).__name__}: its derivative {entry} is {value.item()} "
        f"at t={t.item():g}{member}, where {_letter(place)} itself is finite. {ADVICE}"
    )
