"""What torch computes, written down and computed again one number at a time."""

import pytest
import torch
from oracles import close, draw
from replay import replay

import pypose_lite as pp
from pypose_lite.compiled.places import AsksForTime, Unsupported
from pypose_lite.compiled.recorder import record

pytestmark = pytest.mark.usefixtures("float64")


class Given(pp.NLS):
    """A system whose next state is some function of x (4,), u (2,) and t."""

    vectorized = True

    def __init__(self, function, **kept):
        super().__init__()
        self.function = function
        vars(self).update(kept)

    def state_transition(self, state, input, t):
        y = self.function(state, input, t).to(state.dtype).flatten()
        return torch.cat([y, y.new_zeros(max(0, 4 - len(y)))])[:4] + 0 * state


def again(recording, x, u, t):
    """What was written down, computed again."""
    numbers = [z for p in recording.parameters for z in p.detach().flatten()]
    given = {"x": x, "u": u, "t": t, "number": numbers}
    return replay(recording.arithmetic, recording.next_state.tolist(), **given)


def assigned(x, u, t):
    y = torch.zeros(4)
    y[0] = x[1]
    y[1:3] = u * 2
    y[-1] += x[0] - 1
    y[torch.tensor([0, 2])] = y[torch.tensor([2, 0])]
    y[1].fill_(3)
    return y


def swapped(x, u, t):
    y = x.clone()
    half = y.view(2, 2)
    half[0] *= half[1]
    half.mT[0].sub_(u)
    return y


M = torch.tensor([[2.0, 0.5], [0.3, -1.0]], dtype=torch.float64)
FUNCTIONS = {
    "arithmetic": lambda x, u, t: (x - 2) * x / (3 + x) + torch.add(x, x, alpha=2) - (1 - x),
    "functions": lambda x, u, t: torch.stack(
        [x[0].sin(), x[1].exp(), torch.atan2(u[0], x[2]), x[3].tanh()]
    ),
    "more": lambda x, u, t: torch.stack(
        [x[0].log1p(), x[1].rsqrt(), torch.sigmoid(x[2]), x[3].erf()]
    ),
    "powers": lambda x, u, t: torch.stack([x[0] ** 3, x[1] ** -0.5, 2 ** x[2], x[3].square()]),
    "roundings": lambda x, u, t: torch.stack(
        [(5 * x[0]).floor(), (5 * x[1]) % 2, (5 * x[2]).round(), -x[3].ceil()]
    ),
    "choices": lambda x, u, t: torch.where((x > 0.5) & ~(x > 0.8) | (x < 0.2), x, -x).clamp(
        -0.6, 0.7
    ),
    "extremes": lambda x, u, t: torch.stack(
        [x.amax(), x.amin(), torch.maximum(u[0], x[0]), x.relu().prod()]
    ),
    "sums": lambda x, u, t: torch.stack(
        [x.sum(), x.mean(), x.cumsum(0)[2], x.reshape(2, 2).sum(1)[1]]
    ),
    "norms": lambda x, u, t: torch.stack(
        [x.norm(), torch.linalg.vector_norm(u), torch.hypot(x[0], u[1]), (x - u[0]).norm(1)]
    ),
    "products": lambda x, u, t: torch.cat([M @ u, x.view(2, 2) @ u]),
    "more products": lambda x, u, t: torch.einsum("i,jk,k->ij", u, x.view(2, 2), u),
    "batches": lambda x, u, t: (
        (x.view(2, 1, 2) @ M.expand(2, 2, 2)).flatten() + torch.outer(u, u).flatten()
    ),
    "solve": lambda x, u, t: torch.linalg.solve(x.view(2, 2) + M, torch.stack([u, u + 1])),
    "inverse": lambda x, u, t: torch.linalg.inv(M + x.view(2, 2)),
    "swapped rows": lambda x, u, t: torch.linalg.solve(
        torch.tensor([[0.0, 1.0], [1.0, 0.0]]) + 0 * u[0], u
    ),
    "cross": lambda x, u, t: torch.linalg.cross(x[:3], x[1:]),
    "moves": lambda x, u, t: torch.stack(
        [x.flip(0)[0], x.roll(1)[0], torch.cat([u, x])[3], x.repeat(2)[5]]
    ),
    "picks": lambda x, u, t: (
        x[torch.tensor([3, 0, 1, 1])] + x.gather(0, torch.tensor([1, 1, 2, 0]))
    ),
    "stacks": lambda x, u, t: (
        torch.stack(x.split(2), 1).flatten() + torch.tril(x.view(2, 2)).flatten()
    ),
    "pads": lambda x, u, t: torch.nn.functional.pad(u, (1, 1), value=2.0),
    "types": lambda x, u, t: (9 * x).to(torch.int64) // 2 + (x > 0.4).to(x.dtype) + (x > 0.4).sum(),
    "masks": lambda x, u, t: x.masked_fill(x > 0.5, 2.0) + torch.logical_or(x > 0.1, x < 0),
    "time": lambda x, u, t: torch.sin(0.3 * t) * x + torch.tensor([1.0, 2.0, 3.0])[t.flatten() % 3],
    "from the end": lambda x, u, t: torch.stack([x, 2 * x])[t.flatten() % 2 - 2][0],
    "assignments": assigned,
    "writes into views": swapped,
    "network": torch.no_grad()(lambda x, u, t: NET(torch.cat([x, u]))),
    "transforms": lambda x, u, t: (
        torch.func.jacrev(lambda z: (z**2).sum() * z)(x)[0] + torch.vmap(torch.sin)(x)
    ),
    "gradients": lambda x, u, t: slope(x),
    "poses": lambda x, u, t: (pp.se3(torch.cat([x, u])).Exp() @ torch.ones(3)).flatten(),
}
torch.manual_seed(0)
NET = torch.nn.Sequential(
    torch.nn.Linear(6, 5), torch.nn.Softplus(), torch.nn.Linear(5, 4)
).double()


def slope(x):
    with torch.enable_grad():
        x = x.detach().requires_grad_()
        return torch.autograd.grad((x.sin() * x).sum(), x)[0]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_what_is_written_down_is_what_torch_computes(g, name):
    if name == "poses" and torch.__version__ < "2.13":
        pytest.skip("an older torch cannot make a subclass of what it shows to a dispatch mode")
    system = Given(FUNCTIONS[name])
    for t in (0, 1, 5):
        x, u = draw(g, 4).abs(), draw(g, 2).abs()
        recording = record(system, 4, 2, torch.float64)
        close(again(recording, x, u, t), system.transition(x, u, torch.tensor(t)), 1e-12)


def test_tensors_of_the_system_are_parameters(g):
    A, b = draw(g, 4, 4), draw(g, 4)
    system = Given(lambda x, u, t: A.mT @ x + A[0] * b)
    recording = record(system, 4, 2, torch.float64)
    x, u = draw(g, 4), draw(g, 2)
    A.mul_(3)
    b.add_(1)
    close(again(recording, x, u, 0), system.transition(x, u), 1e-12)
    assert recording.fixed == []


def test_indices_of_the_system_are_fixed(g):
    order = torch.tensor([3, 0, 1, 1])
    recording = record(Given(lambda x, u, t: x[order] + x.gather(0, order)), 4, 2, torch.float64)
    assert len(recording.fixed) == 1 and torch.equal(recording.fixed[0][1], order)


def test_a_value_that_is_asked_for_is_fixed_or_the_times():
    mass = torch.tensor(2.0)
    assert record(Given(lambda x, u, t: x * float(mass)), 4, 2, torch.float64).fixed
    with pytest.raises(AsksForTime):
        record(Given(lambda x, u, t: x * int(t)), 4, 2, torch.float64)
    assert record(Given(lambda x, u, t: x * int(t)), 4, 2, torch.float64, 3).arithmetic


REFUSED = {
    "branches on a state": lambda x, u, t: x if x[0] > 0 else -x,
    "branches on a state or an input": lambda x, u, t: x * float(u[0]),
    "draws random numbers": lambda x, u, t: x + torch.rand(4),
    "uses sort": lambda x, u, t: x.sort().values,
    "indexes a tensor by what it has computed": lambda x, u, t: x.gather(0, (x > 0).long()),
    "uses sin with out=": lambda x, u, t: torch.sin(x, out=torch.empty(4)),
    "writes into a tensor that it keeps": lambda x, u, t: torch.add(KEPT.add_(1), x),
    "has a tensor of another kind": lambda x, u, t: x * IMAGINARY.real,
}
KEPT, IMAGINARY = torch.zeros(4), torch.zeros(4, dtype=torch.complex128)


@pytest.mark.parametrize("why", REFUSED)
def test_what_cannot_be_written_down_is_named(why):
    with pytest.raises(Unsupported, match=why):
        record(Given(REFUSED[why]), 4, 2, torch.float64)
    assert (KEPT == 0).all()
