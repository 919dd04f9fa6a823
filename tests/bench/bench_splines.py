"""Splines through the 17 waypoints, and through 64 noisy copies, beside PyPose's and SciPy's."""

import numpy as np
import pytest
import scipy.interpolate
import torch

import pypose_lite
from pypose_lite import infinity

SAMPLES = 20  # a segment


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


def waypoints(count):
    g = torch.Generator().manual_seed(0)
    path = infinity.waypoints()[:, :2].double()
    return path + 0.1 * torch.randn(count, *path.shape, generator=g, dtype=torch.float64)


def scipy_hermite(points, interval):
    """Central differences as tangents, as ours; SciPy takes a batch as further columns."""
    p = points.numpy().swapaxes(0, 1)
    knots, slopes = np.arange(len(p)), np.gradient(p, axis=0)
    t = np.linspace(0, len(p) - 1, (len(p) - 1) * SAMPLES + 1)
    return torch.from_numpy(scipy.interpolate.CubicHermiteSpline(knots, p, slopes)(t)).movedim(0, 1)


def scipy_bspline(points, interval):
    p = points.numpy().swapaxes(0, 1)
    knots = np.arange(-3, len(p) + 1)
    t = np.linspace(0, len(p) - 3, (len(p) - 3) * SAMPLES + 1)
    return torch.from_numpy(scipy.interpolate.BSpline(knots, p, 3)(t)).movedim(0, 1)


def pypose(name):
    return lambda points, interval: getattr(pytest.importorskip("pypose"), name)(points, interval)


SIDES = {
    "chspline": {
        "ours": pypose_lite.chspline,
        "PyPose": pypose("chspline"),
        "SciPy": scipy_hermite,
    },
    "bspline": {"ours": pypose_lite.bspline, "PyPose": None, "SciPy": scipy_bspline},
    "bspline of poses": {"ours": pypose_lite.bspline, "PyPose": pypose("bspline")},
}


@pytest.mark.parametrize("count", [1, 64])
@pytest.mark.parametrize(
    "kind, side", [(kind, side) for kind, sides in SIDES.items() for side in sides if sides[side]]
)
def test_spline(benchmark, kind, side, count):
    benchmark.group = f"{kind}, {count} curve{'s' if count > 1 else ''} through 17 points"
    benchmark.extra_info["side"] = side
    points = waypoints(count)
    if kind == "bspline of poses":
        points = poses(points, side)
    sampled = benchmark(SIDES[kind][side], points, 1 / SAMPLES)
    if kind != "bspline of poses":
        expected = SIDES[kind]["ours"](points, 1 / SAMPLES)
        torch.testing.assert_close(sampled, expected, atol=1e-9, rtol=0)


def poses(points, side):
    """The waypoints on the ground, turned by small angles."""
    half = 0.1 * points[..., :1]
    rest = torch.zeros_like(points)
    data = torch.cat([points, rest[..., :1], rest, half.sin(), half.cos()], dim=-1)
    module = pypose_lite if side == "ours" else pytest.importorskip("pypose")
    return module.SE3(data)
