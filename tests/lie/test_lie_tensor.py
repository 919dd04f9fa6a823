"""Tensors of rotations and poses: matrices as oracles, and a type that survives moving rows."""

import copy

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import pypose_lite as pp
from pypose_lite import lie
from pypose_lite.lie import SE3, SO3, se3, so3

F64 = torch.float64
RANDOM = {SO3: pp.randn_SO3, SE3: pp.randn_SE3}
each_group = pytest.mark.parametrize("group", [SO3, SE3])


def close(a, b, atol=1e-12):
    a, b = (x.as_subclass(torch.Tensor) for x in (a, b))
    torch.testing.assert_close(a, b, atol=atol, rtol=1e-12)


def sample(group, *lshape, seed=0, **options):
    generator = torch.Generator().manual_seed(seed)
    return RANDOM[group](*lshape, generator=generator, dtype=F64, **options)


def hat(a):
    """The matrices of tangents, written out by hand."""
    x, y, z = a.as_subclass(torch.Tensor)[..., -3:].unbind(-1)
    o = torch.zeros_like(x)
    rows = [[o, -z, y], [z, o, -x], [-y, x, o]]
    turn = torch.stack([torch.stack(row, -1) for row in rows], -2)
    if a.shape[-1] == 3:
        return turn
    top = torch.cat([turn, a.as_subclass(torch.Tensor)[..., :3, None]], -1)
    return torch.cat([top, torch.zeros_like(top[..., :1, :])], -2)


def test_the_numbers_of_a_pose_are_translation_then_quaternion_xyzw():
    T = sample(SE3, 4, 2)
    q = T.tensor()[..., 3:].reshape(-1, 4).numpy()
    rotations = torch.from_numpy(Rotation.from_quat(q).as_matrix()).reshape(4, 2, 3, 3)
    close(T.matrix()[..., :3, 3], T.translation())
    close(T.matrix()[..., :3, :3], rotations)
    close(T.rotation().matrix(), rotations)
    assert isinstance(T.rotation(), SO3) and type(T.translation()) is torch.Tensor


@each_group
def test_exp_and_log_are_those_of_matrices(group):
    X = sample(group, 4, 2)
    a = X.Log()
    assert isinstance(a, group.algebra) and isinstance(a.Exp(), group)
    close(X.matrix(), torch.linalg.matrix_exp(hat(a)))
    close(a.matrix(), X.matrix())
    close(a.Inv().matrix(), torch.linalg.inv(X.matrix()))
    close((0.5 * a).matrix() @ (0.5 * a).matrix(), X.matrix())


@each_group
def test_products_and_inverses_are_those_of_matrices(group):
    X, Y = sample(group, 4, 2), sample(group, 2, seed=1)
    close((X @ Y).matrix(), X.matrix() @ Y.matrix())
    close((X * Y).tensor(), (X @ Y).tensor())
    close(X.Inv().matrix(), torch.linalg.inv(X.matrix()))
    p = torch.randn(2, 3, dtype=F64)
    homogeneous = torch.cat([p, torch.ones(2, 1, dtype=F64)], -1)[..., : X.matrix().shape[-1]]
    moved = (X.matrix() @ homogeneous[..., None])[..., :3, 0]
    for way in (X @ p, X * p, X.Act(p)):
        close(way, moved)


@each_group
def test_retr_adj_and_adjt_move_a_tangent_past_an_element(group):
    X, a = sample(group, 4, 2), sample(group, 2, seed=1).Log()
    A = torch.linalg.matrix_exp(hat(a))
    close(X.Retr(a).matrix(), A @ X.matrix())
    close((X + a.tensor()).matrix(), A @ X.matrix())
    close(X.Adj(a).matrix() @ X.matrix(), X.matrix() @ A)
    close(X.matrix() @ X.AdjT(a.tensor()).matrix(), A @ X.matrix())


@each_group
@pytest.mark.parametrize("angle", [0.0, 1e-7, 3.14159])
@pytest.mark.parametrize("dtype", [torch.float32, F64])
def test_methods_have_finite_values_and_gradients_at_delicate_angles(group, angle, dtype):
    a = torch.zeros(group.algebra.width, dtype=dtype)
    a[-1] = angle
    a.requires_grad_()
    X = group.algebra(a).Exp()
    results = [X.Log(), X.Retr(X.Log()), X.Adj(a), X.AdjT(a), X.Inv(), X.matrix(), X.euler()]
    numbers = [x.as_subclass(torch.Tensor).flatten() for x in results]
    torch.cat(numbers).sum().backward()
    assert a.grad.isfinite().all()


@each_group
def test_what_moves_rows_keeps_the_type_and_arithmetic_loses_it(group):
    X = sample(group, 4, 2)
    kept = [X[0], X[..., 1, :], X.reshape(8, -1), X.lview(8), X.float(), X.clone(), X[:, None]]
    kept += [torch.cat([X, X]), torch.stack([X, X]), X.unbind(0)[1], X.expand(3, 4, 2, -1)]
    kept += [X @ X, X.Inv(), X.Log().Exp(), X.transpose(0, 1), X.contiguous()]
    assert all(type(x) is group for x in kept)
    lost = [X[..., :2], X - X, X.sum(), X.matrix(), 2 * X, X.abs(), X.euler(), X.tensor()]
    assert all(type(x) is torch.Tensor for x in lost)
    assert type(0.5 * X.Log() - X.Log() / 3) is group.algebra


@each_group
def test_what_is_no_product_is_refused(group):
    X = sample(group, 2)
    for call in (lambda: X @ 2.0, lambda: X + 1, lambda: X @ X.Log()):
        with pytest.raises(TypeError):
            call()
    with pytest.raises(TypeError, match=r"expected S[OE]3 or points \(\.\.\., 3\) on the right"):
        sample(group) @ (sample(SO3) if group is SE3 else sample(SE3))
    with pytest.raises(ValueError, match=r"expected \(\.\.\., n=[36]\), got \(2, [47]\)"):
        X + X.tensor()


@each_group
def test_elements_are_learned_copied_and_saved(group):
    module, X = torch.nn.Module(), sample(group, 4, 2)
    module.X = torch.nn.Parameter(X)
    (module.X.Log() ** 2).sum().backward()
    (learned,) = module.parameters()
    assert learned.grad.shape == X.shape and learned.grad.isfinite().all()
    twin = copy.deepcopy(module)
    assert isinstance(twin.X, group) and isinstance(twin.X, torch.nn.Parameter)
    with torch.no_grad():
        twin.X.zero_()
    close(module.X, X)
    module.load_state_dict(module.state_dict())
    assert isinstance(module.X, group) and isinstance(module.float().X, group)


@each_group
def test_the_methods_equal_pyposes(group):
    pypose = pytest.importorskip("pypose")
    X, a, p = sample(group, 4, 2), sample(group, 2, seed=1).Log(), torch.randn(2, 3, dtype=F64)
    theirs = getattr(pypose, group.__name__)(X.tensor())
    other = getattr(pypose, group.algebra.__name__)(a.tensor())
    for name in ("Log", "Inv", "matrix", "euler", "rotation"):
        close(getattr(X, name)(), getattr(theirs, name)())
    for name in ("Log", "Inv", "euler"):
        close(getattr(pp, name)(X), getattr(pypose, name)(theirs))
    for name in ("Retr", "Adj", "AdjT"):
        close(getattr(X, name)(a), getattr(theirs, name)(other))
        close(getattr(pp, name)(X, a), getattr(pypose, name)(theirs, other))
    close(pp.Exp(a), pypose.Exp(other))
    close(pp.Mul(X, X[0]), pypose.Mul(theirs, theirs[0]))
    close(pp.Act(X, p), pypose.Act(theirs, p))
    close(X + a, theirs + other)
    close(pp.Inv(a), pypose.Inv(other))


def test_each_is_function_knows_its_own_kind():
    kinds = {"SO3": pp.identity_SO3(), "so3": pp.identity_so3()}
    kinds |= {"SE3": pp.identity_SE3(), "se3": pp.identity_se3()}
    for name in kinds:
        found = {kind for kind, x in kinds.items() if getattr(pp, f"is_{name}")(x)}
        assert found == {name} and pp.is_lietensor(kinds[name])
    assert not pp.is_lietensor(torch.zeros(4)) and not pp.is_SO3([0, 0, 0, 1.0])


def test_lists_and_arrays_are_taken():
    assert SE3(np.array([0, 0, 0, 0, 0, 0, 1.0])).dtype == F64
    assert SO3([[0, 0, 0, 1], [0, 0, 1, 0]]).lshape == (2,) and so3([0, 0, 1]).dtype == torch.float


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: SE3([0.0, 0, 0, 1, 1, 0, 0]), "SE3: .*unit quaternion .*, got length 1.414"),
        (lambda: SO3([0.0, 0, 0, 0]), "SO3: .*unit quaternion x, y, z, w, got length 0"),
        (lambda: SE3(torch.zeros(3, 6)), r"SE3: expected \(\.\.\., n=7\), got \(3, 6\)"),
        (lambda: SO3(torch.zeros(3, 3)), r"SO3: expected \(\.\.\., n=4\), got \(3, 3\)"),
        (lambda: se3([0, 1]), r"se3: expected \(\.\.\., n=6\), got \(2,\)"),
        (lambda: so3(torch.full((3,), torch.nan)), "so3: expected finite numbers, got nan"),
        (lambda: lie.so3_bracket(torch.zeros(3), torch.zeros(4)), r"b: expected \(\.\.\., n=3\)"),
    ],
)
def test_data_that_is_no_rotation_or_pose_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
