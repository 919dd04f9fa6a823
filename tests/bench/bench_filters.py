"""One step of each filter, beside PyPose's and filterpy's, and a thousand cars at once.

The filters agree about the step but not about time: with us y observes the state before the step,
so an update comes first. In PyPose y is of the next state for the UKF, and the EKF's innovation
mixes both. So every estimate has to be near where the step leads, and filterpy's, in our order,
equal to ours. A *vectorized system* says that its functions take batches, which saves a `vmap`.
"""

import numpy as np
import pytest
import torch

import pypose_lite
from pypose_lite.filters import EKF, PF, UKF

OURS = {"EKF": EKF, "UKF": UKF, "PF": PF}
CARS = 1000


def car(module):
    """The paper's Dubins car as a user of either library writes it."""

    class Car(module.NLS):
        def state_transition(self, state, input, t=None):
            v, phi = input[..., 0], input[..., 1]
            theta = torch.atan2(state[..., 3], state[..., 2]) + phi * 0.1
            c, s = theta.cos(), theta.sin()
            i = state[..., 0] + v * c * 0.1
            j = state[..., 1] + v * s * 0.1
            return torch.stack([i, j, c, s], dim=-1)

        def observation(self, state, input, t=None):
            return state

    return Car()


def vectorized_car():
    model = car(pypose_lite.module)
    model.vectorized = True
    return model


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


@pytest.fixture
def step():
    """Estimate, observation, input, P, Q, R of one step."""
    x, u, one = torch.tensor([0.0, 0.0, 1.0, 0.0]), torch.tensor([1.3, 1.3]), torch.eye(4)
    return x, x + 0.1, u, 0.05**2 * one, 0.005**2 * one, 0.163**2 * one


def estimate(benchmark, step, filter):
    """Times one step, and returns where the car then is, which is near where the step leads."""
    filter(*step)  # the first call loads what later ones need
    x, _ = benchmark(filter, *step)
    assert (x - car(pypose_lite.module).state_transition(step[0], step[2])).abs().max() < 0.05
    return x


@pytest.mark.parametrize("name", OURS)
def test_ours(benchmark, step, name):
    benchmark.group = f"One {name} step"
    benchmark.extra_info["side"] = "ours"
    estimate(benchmark, step, OURS[name](car(pypose_lite.module)))


@pytest.mark.parametrize("name", OURS)
def test_ours_vectorized(benchmark, step, name):
    benchmark.group = f"One {name} step"
    benchmark.extra_info["side"] = "ours, vectorized system"
    estimate(benchmark, step, OURS[name](vectorized_car()))


@pytest.mark.parametrize("name", OURS)
def test_pypose(benchmark, step, name):
    module = pytest.importorskip("pypose").module
    benchmark.group = f"One {name} step"
    benchmark.extra_info["side"] = "PyPose"
    estimate(benchmark, step, getattr(module, name)(car(module)))


def test_filterpy_ekf(benchmark, step):
    """Jacobians written by hand, in NumPy: what one step costs without torch."""
    kalman = pytest.importorskip("filterpy.kalman")
    benchmark.group = "One EKF step"
    benchmark.extra_info["side"] = "filterpy, NumPy, Jacobians by hand"
    x, y, (v, phi), P, Q, R = (part.double().numpy() for part in step)
    ekf = kalman.ExtendedKalmanFilter(dim_x=4, dim_z=4)
    ekf.Q, ekf.R = Q, R

    def once():
        ekf.x, ekf.P = x.copy(), P.copy()
        ekf.update(y, lambda x: np.eye(4), lambda x: x)
        i, j, c, s = ekf.x
        theta, r2 = np.arctan2(s, c) + phi * 0.1, c * c + s * s
        C, S = np.cos(theta), np.sin(theta)
        dtheta = np.array([0, 0, -s / r2, c / r2])
        ekf.F = np.outer([-S * v * 0.1, C * v * 0.1, -S, C], dtheta)
        ekf.F[0, 0] = ekf.F[1, 1] = 1
        ekf.x = np.array([i + v * C * 0.1, j + v * S * 0.1, C, S])
        ekf.P = ekf.F @ ekf.P @ ekf.F.T + Q
        return ekf.x

    x = torch.from_numpy(benchmark(once)).float()
    torch.testing.assert_close(x, EKF(vectorized_car())(*step)[0])


@pytest.mark.parametrize("cars", [1, CARS])
@pytest.mark.parametrize("name", OURS)
def test_a_batch(benchmark, step, name, cars):
    benchmark.group = f"{name}, one car and {CARS}"
    side = "one car" if cars == 1 else f"{cars} cars"
    benchmark.extra_info |= {"side": side, "count": cars}
    x, y, u, *rest = step
    batch = (cars,) if cars > 1 else ()
    x, y, u = (part.expand(*batch, -1).clone() for part in (x, y, u))
    estimate(benchmark, (x, y, u, *rest), OURS[name](vectorized_car()))
