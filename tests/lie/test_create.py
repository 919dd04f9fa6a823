"""Rotations from matrices and angles, and random ones, against SciPy and PyPose."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.autograd import gradcheck

import pypose_lite as pp
from pypose_lite.lie import so3_euler

F64 = torch.float64
HALF = math.pi / 2


def close(a, b, atol=1e-12):
    a, b = (x.as_subclass(torch.Tensor) for x in (a, b))
    torch.testing.assert_close(a, b, atol=atol, rtol=1e-12)


def rotations(count=60):
    """Random quaternions, and half turns about the axes and between them."""
    some = Rotation.random(count, rng=0).as_quat()
    grid = torch.cartesian_prod(*[torch.tensor([-1.0, 0, 1], dtype=F64)] * 4)
    grid = grid[grid.norm(dim=-1) > 0]
    return torch.cat([torch.from_numpy(some), grid / grid.norm(dim=-1, keepdim=True)])


def matrices(q):
    return torch.from_numpy(Rotation.from_quat(q.numpy()).as_matrix())


def test_mat2so3_gives_back_the_rotation_of_its_matrix():
    R = matrices(rotations())
    q = pp.mat2SO3(R)
    assert pp.is_SO3(q)
    close(q.tensor().norm(dim=-1), torch.ones(len(q), dtype=F64))
    close(matrices(q.tensor()), R)


def test_mat2se3_takes_all_three_shapes():
    T = pp.randn_SE3(5, 2, dtype=F64, generator=torch.Generator().manual_seed(0))
    M = T.matrix()
    close(pp.mat2SE3(M).matrix(), M)
    close(pp.mat2SE3(M[..., :3, :]).matrix(), M)
    close(pp.mat2SE3(M[..., :3, :3]).matrix()[..., :3, 3], torch.zeros(5, 2, 3, dtype=F64))
    close(pp.mat2SO3(M).matrix(), M[..., :3, :3])
    assert pp.is_SE3(pp.mat2SE3(M)) and pp.mat2SE3(M.tolist()).dtype == torch.get_default_dtype()


def test_matrices_and_angles_give_pyposes_numbers_and_signs():
    pypose = pytest.importorskip("pypose")
    R, angles = matrices(rotations()), 4 * torch.randn(50, 3, dtype=F64)
    close(pp.mat2SO3(R), pypose.mat2SO3(R))
    close(pp.mat2SE3(R), pypose.mat2SE3(R))
    close(pp.euler2SO3(angles), pypose.euler2SO3(angles))
    q = rotations()
    close(pp.SO3(q).euler(), pypose.SO3(q).euler(), atol=2e-8)  # theirs is an arcsine, near 1
    generic = q[:60]
    close(pp.SO3(generic).euler(), pypose.SO3(generic).euler())
    close(pp.SO3(generic).euler(eps=0.3), pypose.SO3(generic).euler(eps=0.3))


def test_euler_angles_are_scipys_turns_about_the_outer_axes():
    angles = (torch.rand(50, 3, dtype=F64) - 0.5) * torch.tensor([6.2, 3.0, 6.2], dtype=F64)
    theirs = Rotation.from_euler("xyz", angles.numpy())
    close(pp.euler2SO3(angles).matrix(), torch.from_numpy(theirs.as_matrix()))
    close(pp.euler2SO3(angles).euler(), angles, atol=1e-11)
    pose = torch.cat([torch.zeros(50, 3, dtype=F64), pp.euler2SO3(angles).tensor()], -1)
    close(pp.SE3(pose).euler(), angles, atol=1e-11)
    close(pp.euler2SO3(angles).Log().euler(), angles, atol=1e-11)


@pytest.mark.parametrize("pitch", [HALF, -HALF, HALF - 1e-9, 1e-3 - HALF])
def test_at_the_gimbal_lock_the_angles_give_back_the_rotation(pitch):
    q = pp.euler2SO3(torch.tensor([0.7, pitch, -1.1], dtype=F64))
    angles = q.euler()
    assert angles[0] == 0
    close(pp.euler2SO3(angles).matrix(), q.matrix(), atol=2 * abs(HALF - abs(pitch)) + 1e-12)
    worst = pp.euler2SO3(torch.tensor([1.5, math.asin(1 - 2e-4) + 1e-9, 0.2], dtype=F64))
    assert (pp.euler2SO3(worst.euler()) @ worst.Inv()).Log().tensor().norm() < 0.03


@pytest.mark.parametrize("pitch", [HALF, -HALF, 0.3])
def test_gradients_of_angles_are_finite_everywhere(pitch):
    q = pp.euler2SO3(torch.tensor([0.7, pitch, -1.1], dtype=F64)).tensor().requires_grad_()
    locked = torch.tensor([0.5, 0.5, -0.5, 0.5], dtype=F64, requires_grad=True)  # exactly
    (so3_euler(q) + so3_euler(locked)).sum().backward()
    assert q.grad.isfinite().all() and locked.grad.isfinite().all()


def test_gradients_agree_with_finite_differences():
    angles = torch.tensor([[0.3, -0.4, 2.0], [0.0, 0.0, 0.0]], dtype=F64, requires_grad=True)
    assert gradcheck(lambda a: pp.euler2SO3(a).tensor(), angles)
    assert gradcheck(lambda a: pp.euler2SO3(a).euler(), angles)
    R = matrices(rotations()[:9]).requires_grad_()
    assert gradcheck(lambda R: pp.mat2SO3(R, check=False).tensor(), R)


def test_a_batch_equals_the_stack_of_single_calls():
    R = matrices(rotations())[:12].reshape(3, 4, 3, 3)
    singles = [pp.mat2SO3(x).tensor() for x in R.reshape(-1, 3, 3)]
    close(pp.mat2SO3(R), torch.stack(singles).reshape(3, 4, 4))
    q = pp.mat2SO3(R)
    close(q.euler().reshape(-1, 3), torch.stack([x.euler() for x in q.reshape(-1, 4)]))


def test_float32_matrices_are_rotations_within_the_tolerance():
    R = matrices(rotations())
    close(pp.mat2SO3(R.float()).matrix().double(), R, atol=2e-6)


REFLECTION = torch.diag(torch.tensor([1.0, 1, -1]))
SHEAR = torch.tensor([[1, 1e-3, 0], [0, 1, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: pp.mat2SO3(REFLECTION), "expected rotations .* det R = -1"),
        (
            lambda: pp.mat2SO3(torch.stack([torch.eye(3), 2 * torch.eye(3)])),
            r"mat: expected rotations \(\.\.\., 3, 3\).* R R' off by 3 .* at \(1,\)",
        ),
        (lambda: pp.mat2SO3(SHEAR), "R R' off by 0.001 and det R = 1"),
        (lambda: pp.mat2SE3(2 * torch.eye(4)), "mat: expected rotations"),
        (lambda: pp.mat2SE3(torch.eye(4)[[0, 1, 2, 2]]), "last rows \\[0, 0, 0, 1\\], got \\[0.0"),
        (lambda: pp.mat2SO3(torch.eye(2)), r"mat: expected .*\(\.\.\., 4, 4\), got \(2, 2\)"),
        (lambda: pp.mat2SO3(torch.zeros(3)), r"got \(3,\)"),
        (lambda: pp.mat2SO3(torch.full((3, 3), torch.nan), check=False), "finite numbers"),
        (
            lambda: pp.euler2SO3(torch.zeros(2, 4)),
            r"angles: expected \(\.\.\., n=3\), got",
        ),
        (lambda: pp.randn_SE3(sigma=(1.0, 2.0, 3.0)), "sigma: expected 1, 2 or 4 numbers"),
    ],
)
def test_what_is_no_rotation_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_a_tolerance_or_no_check_lets_a_rough_matrix_pass():
    rough = torch.eye(3) + 1e-4
    for q in (pp.mat2SO3(rough, atol=1e-3), pp.mat2SO3(rough, check=False)):
        close(q, torch.tensor([0.0, 0, 0, 1]), atol=1e-4)


NAMES = ["SO3", "so3", "SE3", "se3"]


@pytest.mark.parametrize("name", NAMES)
def test_random_elements_repeat_and_the_identity_moves_nothing(name):
    randn, one = getattr(pp, f"randn_{name}"), getattr(pp, f"identity_{name}")

    def draw(*lshape, **options):
        return randn(*lshape, generator=torch.Generator().manual_seed(3), **options)

    assert torch.equal(draw(5), draw(5)) and draw(5, dtype=F64).dtype == F64
    assert draw(2, requires_grad=True).is_leaf and draw(2, requires_grad=True).requires_grad
    assert draw((2, 3)).lshape == draw(2, 3).lshape == (2, 3) and draw().lshape == ()
    assert one(2, 3).lshape == one((2, 3)).lshape == (2, 3) and one(dtype=F64).dtype == F64
    matrix = one(4).matrix()
    close(matrix, torch.eye(matrix.shape[-1]).expand_as(matrix))


@pytest.mark.parametrize("name", NAMES)
def test_one_seed_gives_pyposes_random_elements(name):
    pypose = pytest.importorskip("pypose")
    for sigma in (1.0, 0.3, *([(2.0, 0.1), (1.0, 2.0, 3.0, 0.1)] if name[1] in "Ee" else [])):
        torch.manual_seed(5)
        ours = getattr(pp, f"randn_{name}")(4, 2, sigma=sigma, dtype=F64)
        torch.manual_seed(5)
        close(ours, getattr(pypose, f"randn_{name}")(4, 2, sigma=sigma, dtype=F64))


def test_random_elements_have_the_spread_asked_for():
    generator = torch.Generator().manual_seed(0)
    xi = pp.randn_SE3(20_000, sigma=(2.0, 0.1), generator=generator, dtype=F64).Log().tensor()
    assert xi[:, :3].std(0) == pytest.approx([2, 2, 2], rel=0.03)
    assert xi[:, 3:].norm(dim=-1).square().mean().sqrt().item() == pytest.approx(0.1, rel=0.03)
    close(xi[:, 3:].mean(0), torch.zeros(3, dtype=F64), atol=2e-3)
