"""The groups against `matrix_exp`, SciPy and mpmath; their axioms and gradients."""

import math
from typing import Any, NamedTuple

import mpmath
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.autograd import gradcheck, gradgradcheck
from torch.autograd.functional import jacobian

import pypose_lite.lie as lie
from pypose_lite.lie import taylor

F64 = torch.float64
SHAPES = [(), (1,), (3,), (7,), (2, 3)]
ANGLES = [0.0, 1e-12, 1e-7, 1e-4, 0.3, 0.4999, 0.5001, 1.7, 3.0, math.pi - 1e-7]


def hat2(v):
    """The 2x2 generator of SO(2)."""
    return torch.tensor([[0, -1], [1, 0]], dtype=v.dtype) * v[..., None]


def hat3(v):
    """The matrix of ``v x``."""
    eps = torch.zeros(3, 3, 3, dtype=v.dtype)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        eps[i, k, j], eps[i, j, k] = 1, -1
    return torch.einsum("ijk,...k->...ij", eps, v)


def affine(hat, rho):
    """The generator of a pose: rotation's beside translation's, over a row of zeros."""
    top = torch.cat([hat, rho[..., None]], -1)
    return torch.cat([top, torch.zeros_like(top[..., :1, :])], -2)


class Group(NamedTuple):
    name: str
    tangent: int
    space: int
    hat: Any

    def __getattr__(self, function):
        return getattr(lie, f"{self.name}_{function}")

    def __repr__(self):
        return self.name

    def twist(self, angle, *shape, seed=0, dtype=F64):
        """Random tangents whose rotation has the given angle."""
        g = torch.Generator().manual_seed(seed)
        xi = torch.randn(*shape, self.tangent, generator=g, dtype=F64)
        spin = {2: 1, 3: 3}[self.space]
        rho, phi = xi[..., :-spin], xi[..., -spin:]
        return torch.cat([rho, angle * phi / phi.norm(dim=-1, keepdim=True)], -1).to(dtype)

    def sample(self, *shape, seed=0):
        g = torch.Generator().manual_seed(seed)
        return self.exp(torch.randn(*shape, self.tangent, generator=g, dtype=F64))


GROUPS = [
    Group("so2", 1, 2, hat2),
    Group("se2", 3, 2, lambda xi: affine(hat2(xi[..., 2:]), xi[..., :2])),
    Group("so3", 3, 3, hat3),
    Group("se3", 6, 3, lambda xi: affine(hat3(xi[..., 3:]), xi[..., :3])),
]
each_group = pytest.mark.parametrize("G", GROUPS, ids=repr)


def close(a, b, atol=1e-12, rtol=1e-12):
    torch.testing.assert_close(a, b, atol=atol, rtol=rtol)


# exp and log


@each_group
@pytest.mark.parametrize("angle", [*ANGLES, math.pi, 5.0, 20.0])
def test_exp_is_the_matrix_exponential(G, angle):
    xi = G.twist(angle, 5)
    close(G.matrix(G.exp(xi)), torch.linalg.matrix_exp(G.hat(xi)), atol=2e-13 * (1 + angle))


@each_group
@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp(G, angle):
    xi = G.twist(angle, 5)
    close(G.log(G.exp(xi)), xi, atol=1e-14 * (1 + 1e1 * angle))


@each_group
@pytest.mark.parametrize("angle", [math.pi, 4.0, 6.2])
def test_log_of_more_than_half_a_turn_takes_the_short_way_round(G, angle):
    T = G.exp(G.twist(angle, 5))
    xi = G.log(T)
    spin = xi[..., -1:] if G.space == 2 else xi[..., -3:]
    close(spin.norm(dim=-1), torch.full((5,), min(angle, 2 * math.pi - angle), dtype=F64))
    close(G.matrix(G.exp(xi)), G.matrix(T))


@pytest.mark.parametrize("angle", [0.0, 1e-7, 1.0, 3.0, math.pi - 1e-7])
def test_a_quaternion_and_its_negative_have_one_log(angle):
    q = lie.so3_exp(GROUPS[2].twist(angle, 5))
    close(lie.so3_log(-q), lie.so3_log(q), atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 0.3, 2.0, math.pi - 1e-7, math.pi])
def test_so3_equals_scipys_rotation(angle):
    phi = GROUPS[2].twist(angle, 6)
    reference = Rotation.from_rotvec(phi.numpy())
    q, p = lie.so3_exp(phi), torch.randn(6, 3, dtype=F64)
    close(q, torch.from_numpy(reference.as_quat()))
    close(lie.so3_matrix(q), torch.from_numpy(reference.as_matrix()))
    close(lie.so3_act(q, p), torch.from_numpy(reference.apply(p.numpy())))
    close(lie.so3_inverse(q), torch.from_numpy(reference.inv().as_quat()))
    other = Rotation.random(6, rng=0)
    product = lie.so3_compose(q, torch.from_numpy(other.as_quat()))
    close(lie.so3_matrix(product), torch.from_numpy((reference * other).as_matrix()))


# gradients at the delicate places


@each_group
@pytest.mark.parametrize("angle", [*ANGLES, math.pi])
def test_the_gradient_of_exp_is_that_of_the_matrix_exponential(G, angle):
    xi = G.twist(angle)
    ours = jacobian(lambda z: G.matrix(G.exp(z)), xi)
    theirs = jacobian(lambda z: torch.linalg.matrix_exp(G.hat(z)), xi)
    close(ours, theirs, atol=1e-11)


@each_group
@pytest.mark.parametrize("angle", ANGLES)
def test_the_gradient_of_log_inverts_that_of_exp(G, angle):
    xi = G.twist(angle)
    chain = jacobian(G.log, G.exp(xi)) @ jacobian(G.exp, xi)
    close(chain, torch.eye(G.tangent, dtype=F64), atol=1e-11)


@each_group
@pytest.mark.parametrize("angle", ANGLES)
def test_float32_values_and_gradients_are_finite_and_right(G, angle):
    xi, xi32 = G.twist(angle), G.twist(angle, dtype=torch.float32)
    exact = G.exp(xi32.double())  # of the same, rounded, tangent
    close(G.exp(xi32).double(), exact, atol=1e-6, rtol=1e-6)
    close(jacobian(G.exp, xi32).double(), jacobian(G.exp, xi), atol=1e-5, rtol=1e-5)
    log32 = jacobian(G.log, exact.float()).double()
    close(log32, jacobian(G.log, exact.float().double()), atol=2e-5, rtol=2e-5)


@each_group
@pytest.mark.parametrize("dtype, angle", [(torch.float32, 1e10), (F64, 1e40)])
def test_values_and_gradients_of_a_huge_angle_are_finite(G, dtype, angle):
    xi = G.twist(angle, dtype=dtype).requires_grad_()
    T = G.exp(xi)
    T.sum().backward()
    assert T.isfinite().all() and xi.grad.isfinite().all()


@each_group
@pytest.mark.parametrize("angle", [0.0, 1e-7, 2.0, math.pi - 0.01])
def test_gradients_agree_with_finite_differences(G, angle):
    xi = G.twist(angle, 2).requires_grad_()
    T = G.exp(xi.detach()).requires_grad_()
    S = G.sample(1, seed=1).requires_grad_()
    p = torch.randn(2, G.space, dtype=F64, requires_grad=True)
    assert gradcheck(G.exp, xi)
    assert gradcheck(G.log, T)
    assert gradcheck(G.compose, (S, T))
    assert gradcheck(G.inverse, T)
    assert gradcheck(G.act, (T, p))
    assert gradcheck(G.matrix, T)
    assert G.name == "so2" or gradcheck(G.adjoint, T)


@each_group
@pytest.mark.parametrize("angle", [0.0, 2.0])
def test_second_gradients_agree_with_finite_differences(G, angle):
    xi = G.twist(angle).requires_grad_()
    assert gradgradcheck(G.exp, xi)
    assert gradgradcheck(G.log, G.exp(xi.detach()).requires_grad_())


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.4999, 0.5001, 1.0, 2.0, math.pi])
@pytest.mark.parametrize(
    "ours, exact",
    [
        (taylor.sinc_half, lambda x: mpmath.sin(mpmath.sqrt(x) / 2) / mpmath.sqrt(x)),
        (taylor.cos_half, lambda x: mpmath.cos(mpmath.sqrt(x) / 2)),
        (
            taylor.sine_defect,
            lambda x: (mpmath.sqrt(x) - mpmath.sin(mpmath.sqrt(x))) / mpmath.sqrt(x) ** 3,
        ),
        (
            taylor.cot_defect,
            lambda x: (1 - mpmath.sqrt(x) / 2 * mpmath.cot(mpmath.sqrt(x) / 2)) / x,
        ),
    ],
    ids=["sinc_half", "cos_half", "sine_defect", "cot_defect"],
)
def test_the_coefficients_and_two_derivatives_equal_mpmath(ours, exact, angle):
    x = torch.tensor(angle**2, dtype=F64, requires_grad=True)
    value = ours(x)
    (first,) = torch.autograd.grad(value, x, create_graph=True)
    (second,) = torch.autograd.grad(first, x)
    with mpmath.workdps(60):
        wanted = mpmath.taylor(exact, mpmath.mpf(angle) ** 2 + mpmath.mpf("1e-20"), 2)
    got = [value.item(), first.item(), second.item() / 2]
    digits = 1e-13 if angle < 0.5 else 1e-9  # the series is exact, the closed forms cancel
    assert got == pytest.approx([float(w) for w in wanted], rel=digits, abs=1e-16)


# the axioms


@each_group
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_group_axioms_hold_in_any_batch(G, shape):
    A, B, C = (G.sample(*shape, seed=i) for i in range(3))
    one = G.exp(torch.zeros(G.tangent, dtype=F64))
    close(G.compose(G.compose(A, B), C), G.compose(A, G.compose(B, C)))
    close(G.compose(A, one), A)
    close(G.compose(one, A), A)
    close(G.compose(A, G.inverse(A)), one.expand_as(A))
    close(G.compose(G.inverse(A), A), one.expand_as(A))


@each_group
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_composing_and_acting_are_products_of_matrices(G, shape):
    A, B = G.sample(*shape, seed=1), G.sample(*shape, seed=2)
    p = torch.randn(*shape, G.space, dtype=F64)
    close(G.matrix(G.compose(A, B)), G.matrix(A) @ G.matrix(B))
    rows = G.matrix(A).shape[-1] - G.space  # 1 where there is a translation
    homogeneous = torch.cat([p, torch.ones(*shape, rows, dtype=F64)], -1)
    close(G.act(A, p), (G.matrix(A) @ homogeneous[..., None])[..., : G.space, 0])


@each_group
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_adjoint_moves_a_tangent_across_a_pose(G, shape):
    T, xi = G.sample(*shape, seed=3), G.twist(0.7, *shape)
    left = G.compose(G.compose(T, G.exp(xi)), G.inverse(T))
    moved = (G.adjoint(T) @ xi[..., None])[..., 0]
    close(G.matrix(G.exp(moved)), G.matrix(left))


@pytest.mark.parametrize("G", GROUPS[2:], ids=repr)
def test_the_bracket_is_the_commutator_of_matrices(G):
    a, b = G.twist(1.0, 4, seed=1), G.twist(2.0, 4, seed=2)
    A, B = G.hat(a), G.hat(b)
    close(G.hat(G.bracket(a, b)), A @ B - B @ A)


@each_group
@pytest.mark.parametrize("left, right", [((3, 1), (4,)), ((), (2, 3)), ((5,), ())], ids=str)
def test_batches_broadcast_and_equal_the_stack_of_single_calls(G, left, right):
    A, B = G.sample(*left, seed=1), G.sample(*right, seed=2)
    p = torch.randn(*right, G.space, dtype=F64)
    shape = torch.broadcast_shapes(left, right)
    flat = [x.expand(*shape, x.shape[-1]).reshape(-1, x.shape[-1]) for x in (A, B, p)]
    singles = [(G.compose(a, b), G.act(a, q)) for a, b, q in zip(*flat, strict=True)]
    close(G.compose(A, B).reshape(-1, A.shape[-1]), torch.stack([s[0] for s in singles]))
    close(G.act(A, p).reshape(-1, G.space), torch.stack([s[1] for s in singles]))


@each_group
def test_functional_transforms_pass_through(G):
    xi = G.twist(1.0, 4)
    close(torch.func.vmap(G.exp)(xi), G.exp(xi))
    close(torch.func.jacrev(G.exp)(xi[0]), jacobian(G.exp, xi[0]))


def test_products_of_many_float32_rotations_stay_unit_after_normalizing():
    q = lie.so3_exp(torch.randn(3, generator=torch.Generator().manual_seed(0)))
    total = q
    for _ in range(500):
        total = lie.so3_normalize(lie.so3_compose(total, q))
    close(total.norm(), torch.tensor(1.0), atol=2e-7, rtol=0)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: lie.so3_exp(torch.zeros(4)), r"phi: expected \(\.\.\., n=3\), got \(4,\)"),
        (lambda: lie.se3_log(torch.zeros(2, 6)), r"T: expected \(\.\.\., n=7\), got \(2, 6\)"),
        (lambda: lie.se2_exp(torch.tensor([0, 0, 1])), "xi: expected a floating-point tensor"),
        (lambda: lie.so2_log(torch.tensor([math.nan, 1])), "R: expected finite numbers, got nan"),
        (
            lambda: lie.se3_act(torch.zeros(2, 7), torch.zeros(3, 3)),
            r"p_b: its batch \(3,\) does not broadcast with",
        ),
    ],
)
def test_what_does_not_fit_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
