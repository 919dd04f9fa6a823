"""Rotations and poses inside torch's transforms, and inside the functions of a `System`."""

import pytest
import torch

import pypose_lite as pp

F64 = torch.float64


def poses(*lshape, seed=0):
    return pp.randn_SE3(*lshape, generator=torch.Generator().manual_seed(seed), dtype=F64).tensor()


def twists(*lshape, seed=1):
    return torch.randn(*lshape, 6, generator=torch.Generator().manual_seed(seed), dtype=F64)


def close(a, b, atol=1e-12):
    torch.testing.assert_close(a, b, atol=atol, rtol=1e-12)


FUNCTIONS = {
    "step": lambda x, u: (pp.SE3(x) @ pp.se3(u).Exp()).tensor(),
    "retr": lambda x, u: pp.SE3(x).Retr(pp.se3(u)).tensor(),
    "rotate": lambda x, u: pp.SO3(x[..., 3:]) @ u[..., :3],
    "adj": lambda x, u: (pp.Adj(pp.SE3(x), u) + pp.AdjT(pp.SE3(x), u)).tensor(),
    "log": lambda x, u: pp.Log(pp.SE3(x)).tensor() - u,
    "euler": lambda x, u: pp.SE3(x).euler() + u[..., :3],
    "matrix": lambda x, u: pp.mat2SE3(pp.SE3(x).matrix()).tensor()[..., :6] * u,
    "angles": lambda x, u: pp.euler2SO3(x[..., :3] + u[..., :3]).tensor(),
    "rows": lambda x, u: torch.stack([pp.SE3(x), pp.se3(u).Exp()])[0].Inv().tensor(),
}
each = pytest.mark.parametrize("f", FUNCTIONS.values(), ids=FUNCTIONS)


@each
def test_vmap_equals_the_stack_of_single_calls(f):
    x, u = poses(5), twists(5)
    singles = torch.stack([f(a, b) for a, b in zip(x, u, strict=True)])
    close(torch.vmap(f)(x, u), singles)
    close(torch.vmap(f, (None, 0))(x[0], u), torch.stack([f(x[0], b) for b in u]))


@each
def test_jacobians_of_transforms_equal_central_differences(f):
    x, u, h = poses(), twists(), 1e-6
    eye = torch.eye(6, dtype=F64)
    differences = torch.stack([(f(x, u + h * e) - f(x, u - h * e)) / (2 * h) for e in eye], -1)
    close(torch.func.jacrev(f, 1)(x, u), differences, atol=1e-8)
    close(torch.func.jacfwd(f, 1)(x, u), differences, atol=1e-8)
    total = torch.func.grad(lambda u: f(x, u).sum())(u)
    close(total, differences.sum(0), atol=1e-8)
    many = torch.vmap(torch.func.jacrev(f, 1))(poses(3), twists(3))
    close(many[0], torch.func.jacrev(f, 1)(poses(3)[0], twists(3)[0]))


def test_bad_data_is_refused_inside_grad_where_numbers_can_be_asked_for():
    with pytest.raises(ValueError, match="SE3: expected rows that end with a unit quaternion"):
        torch.func.grad(lambda x: pp.SE3(x).Log().tensor().sum())(2 * poses())


class Body(pp.System):
    """A pose in space that moves by body twists; it counts how often it is asked."""

    calls = 0

    def state_transition(self, state, input, t=None):
        self.calls += 1
        return (pp.SE3(state) @ pp.se3(0.1 * input).Exp()).tensor()

    def observation(self, state, input, t=None):
        return pp.SE3(state).translation()


def test_a_system_of_poses_is_mapped_and_not_looped_over():
    body, x, u = Body(), poses(40), twists(40)
    together = body.transition(x, u)
    assert body.calls == 1
    close(together, torch.stack([body.transition(a, b) for a, b in zip(x, u, strict=True)]))
    body.calls = 0
    A = body.linearize(x, u).A
    assert body.calls < 5
    close(A[3], body.linearize(x[3], u[3]).A)
