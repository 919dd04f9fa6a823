"""The SE3 tensor: its methods are the functions, its type survives what keeps rows."""

import copy
import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import pypose_lite.lie as lie
from pypose_lite.lie import SE3, identity_SE3, is_SE3, randn_SE3, se3

F64 = torch.float64


def close(a, b, atol=1e-12):
    torch.testing.assert_close(a, b, atol=atol, rtol=1e-12)


@pytest.fixture
def poses():
    return randn_SE3(4, 2, generator=torch.Generator().manual_seed(0), dtype=F64)


def test_se3_holds_translation_then_quaternion_xyzw(poses):
    data = poses.tensor()
    assert type(data) is torch.Tensor and poses.lshape == (4, 2)
    matrix = poses.matrix()
    close(matrix[..., :3, 3], poses.translation())
    reference = Rotation.from_quat(data[..., 3:].reshape(-1, 4).numpy()).as_matrix()
    close(matrix[..., :3, :3], torch.from_numpy(reference).reshape(4, 2, 3, 3))
    close(poses.rotation(), data[..., 3:])
    turned = SE3([1, 2, 3, 0, 0, math.sin(math.pi / 4), math.cos(math.pi / 4)])  # a list, too
    close(turned @ torch.tensor([1.0, 0, 0]), torch.tensor([1.0, 3, 3]), atol=1e-6)


def test_se3_methods_are_the_functions(poses):
    T, S, p = poses, poses.flip(0), torch.randn(2, 3, dtype=F64)
    a = torch.randn(6, dtype=F64)
    close(T.Log().tensor(), lie.se3_log(T.tensor()))
    close(T.Log().Exp().matrix(), T.matrix())
    close(T.Inv().matrix(), torch.linalg.inv(T.matrix()))
    close((T @ S).matrix(), T.matrix() @ S.matrix())
    close((T * S).tensor(), (T @ S).tensor())
    close(T @ p, T.Act(p))
    close(T * p, lie.se3_act(T.tensor(), p))
    close((T @ se3(a).Exp()).matrix(), (T.Adj(a).Exp() @ T).matrix())
    close((0.5 * T.Log()).Exp().tensor(), lie.se3_exp(0.5 * lie.se3_log(T.tensor())))


def test_row_operations_keep_poses_and_others_do_not(poses):
    kept = [
        poses[0],
        poses[..., 1, :],
        poses.reshape(8, 7),
        poses.float(),
        poses.clone(),
        torch.cat([poses, poses]),
        torch.stack([poses, poses]),
        poses.unbind(0)[1],
        poses[:, None],
        poses @ poses,
        poses.Inv(),
        poses.Log().Exp(),
    ]
    assert all(is_SE3(x) for x in kept)
    lost = [poses[..., :3], poses + 1, poses.sum(), poses.translation(), poses.matrix(), 2 * poses]
    assert not any(isinstance(x, SE3 | se3) for x in lost)
    assert isinstance(0.5 * poses.Log() - poses.Log() / 3, se3)
    assert not is_SE3(poses.tensor()) and not is_SE3([0.0] * 7)
    with pytest.raises(TypeError):
        poses @ 2.0


def test_poses_are_learned_copied_and_saved(poses):
    module = torch.nn.Module()
    module.T = torch.nn.Parameter(poses)
    (module.T.Log() ** 2).sum().backward()
    (learned,) = module.parameters()
    assert learned.grad.shape == (4, 2, 7) and learned.grad.isfinite().all()
    twin = copy.deepcopy(module)
    assert is_SE3(twin.T) and isinstance(twin.T, torch.nn.Parameter)
    with torch.no_grad():
        twin.T.zero_()
    close(module.T.tensor(), poses.tensor())
    module.load_state_dict(module.state_dict())
    assert is_SE3(module.T) and is_SE3(module.float().T)


def test_random_poses_repeat_and_have_the_spread_asked_for():
    def draw(*lshape, **options):
        return randn_SE3(*lshape, generator=torch.Generator().manual_seed(3), **options)

    assert torch.equal(draw(5), draw(5)) and draw(5, dtype=F64).dtype == F64
    assert draw(2, requires_grad=True).is_leaf
    xi = draw(20_000, sigma=(2.0, 0.1), dtype=F64).Log().tensor()
    assert xi[:, :3].std(0) == pytest.approx([2, 2, 2], rel=0.03)
    assert xi[:, 3:].norm(dim=-1).square().mean().sqrt().item() == pytest.approx(0.1, rel=0.03)
    close(xi[:, 3:].mean(0), torch.zeros(3, dtype=F64), atol=2e-3)


def test_the_identity_moves_nothing(poses):
    one = identity_SE3(2, dtype=F64)
    close((one @ poses).tensor(), poses.tensor())
    assert one.lshape == (2,) and identity_SE3().lshape == ()


def test_se3_agrees_with_pypose(poses):
    pypose = pytest.importorskip("pypose")
    theirs = pypose.SE3(poses.tensor())
    p = torch.randn(2, 3, dtype=F64)
    close(poses.Log().tensor(), theirs.Log().tensor())
    close(poses.Inv().tensor(), theirs.Inv().tensor())
    close((poses @ poses[0]).tensor(), (theirs @ theirs[0]).tensor())
    close(poses @ p, theirs @ p)
    close(poses.matrix(), theirs.matrix())
    close(poses.rotation(), theirs.rotation().tensor())
    a = torch.randn(6, dtype=F64)
    close(poses.Adj(a).tensor(), theirs.Adj(pypose.se3(a)).tensor())


def test_numpy_input_is_taken():
    assert SE3(np.array([0, 0, 0, 0, 0, 0, 1.0])).dtype == F64


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: SE3([0.0, 0, 0, 1, 1, 0, 0]), "unit quaternion x, y, z, w, got length 1.414"),
        (lambda: SE3(torch.zeros(3, 6)), r"SE3: expected \(\.\.\., n=7\), got \(3, 6\)"),
        (lambda: se3([0, 1]), r"se3: expected \(\.\.\., n=6\), got \(2,\)"),
    ],
)
def test_data_that_is_no_pose_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()
