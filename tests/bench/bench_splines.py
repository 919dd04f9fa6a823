"""Splines through the 17 waypoints, and through 64 noisy copies, beside PyPose's and SciPy's.

All sides give the same samples, 20 for each segment. Poses are compared with PyPose alone, since
SciPy has no such curve, and points on a B-spline with SciPy alone, since PyPose's takes only poses.
"""

import numpy as np
import pytest
import scipy.interpolate
import torch

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


def poses(module, points):
    """The waypoints on the ground, turned by small angles."""
    half = 0.1 * points[..., :1]
    rest = torch.zeros_like(points)
    return module.SE3(torch.cat([points, rest[..., :1], rest, half.sin(), half.cos()], dim=-1))


SCIPY = {"chspline": scipy_hermite, "bspline": scipy_bspline}
SIDES = {
    "chspline": ["ours", "PyPose", "SciPy"],
    "bspline": ["ours", "SciPy"],
    "bspline of poses": ["ours", "PyPose"],
}


def spline(kind, side, points):
    """A side's function, and what it takes."""
    if side == "SciPy":
        return SCIPY[kind], points
    module = pytest.importorskip("pypose_lite" if side == "ours" else "pypose")
    return getattr(module, kind.split()[0]), poses(module, points) if "poses" in kind else points


@pytest.mark.parametrize("count", [1, 64])
@pytest.mark.parametrize("kind, side", [(kind, side) for kind in SIDES for side in SIDES[kind]])
def test_spline(benchmark, kind, side, count):
    benchmark.group = f"{kind}, {count} curve{'s' if count > 1 else ''} through 17 points"
    benchmark.extra_info["side"] = side
    sample, data = spline(kind, side, waypoints(count))
    ours, same = spline(kind, "ours", waypoints(count))
    sampled, expected = benchmark(sample, data, 1 / SAMPLES), ours(same, 1 / SAMPLES)
    if "poses" in kind:
        sampled, expected = sampled.matrix(), expected.matrix()
    torch.testing.assert_close(sampled, expected, atol=1e-9, rtol=0)
