"""NEES and NIS: what they are, their intervals, and that the filters pass while faults do not."""

import functools
import math

import numpy as np
import pytest
import scipy.stats
import torch
from filter_helpers import close, draw, linear, record, spd

import pypose_lite as pp
from pypose_lite.filters import EKF, PF, UKF, chi_square_interval, nees, nis, smooth


@pytest.mark.parametrize("dof", [1, 2, 4, 7, 200])
@pytest.mark.parametrize("runs", [1, 50, 64, 6400])
@pytest.mark.parametrize("level", [0.5, 0.95, 0.999])
def test_the_interval_is_scipys(dof, runs, level):
    want = np.array(scipy.stats.chi2.interval(level, dof * runs)) / runs
    np.testing.assert_allclose(chi_square_interval(dof, runs, level), want, rtol=1e-8)


def test_the_interval_of_the_infinity_is_the_designs():
    low, high = chi_square_interval(4, runs=64)
    assert (round(low, 2), round(high, 2)) == (3.34, 4.72)


@pytest.mark.parametrize("bad", [{"dof": 0}, {"runs": 0}, {"level": 1.0}, {"level": 0.0}])
def test_an_interval_of_nothing_is_refused(bad):
    with pytest.raises(ValueError, match="expected dof > 0, runs > 0, 0 < level < 1, got"):
        chi_square_interval(**{"dof": 4} | bad)


def test_nees_and_nis_are_squared_lengths_in_the_metric_of_the_covariance(g):
    x, truth, P = draw(g, 5, 3), draw(g, 3), spd(g, 3, (5,))
    e = (x - truth).unsqueeze(-1)
    close(nees(x, P, truth), (e.mT @ torch.linalg.inv(P) @ e)[:, 0, 0])
    system = linear(g, 2, 1, 3)
    got = EKF(system.model).innovation(system.x, draw(g, 3), draw(g, 1), system.P, system.R)
    want = got.value @ torch.linalg.inv(got.covariance) @ got.value
    close(nis(got), want)


def test_a_certain_error_has_no_nees(g):
    with pytest.raises(ValueError, match="P: expected positive definite"):
        nees(torch.zeros(2), torch.zeros(2, 2), torch.ones(2))


RUNS, STEPS = 50, 60


@functools.cache
def runs():
    """Fifty linear runs whose steps are much longer than sigma."""
    g = torch.Generator().manual_seed(5)
    system = linear(g, 2, 1, 2)
    states, u, y = system.run(g, STEPS, (RUNS,))
    x, P = system.x.expand(RUNS, 2), system.P.expand(RUNS, 2, 2)
    return system, states, u, y, x, P


def means(filter, states, u, y, x, P, **options):
    """Mean NEES and NIS over runs and steps."""
    x, P = record(filter, x, P, y, u, **options)
    now = x[:, :-1], y, u, P[:, :-1]
    return nees(x, P, states).mean().item(), nis(filter.innovation(*now, **options)).mean().item()


def inside(value, dof, count):
    low, high = chi_square_interval(dof, count)
    return low < value < high


@pytest.mark.filterwarnings("ignore:PF")
@pytest.mark.parametrize("kind", [EKF, UKF, PF])
def test_fifty_linear_runs_are_consistent(kind):
    system, *run = runs()
    options = {"generator": torch.Generator().manual_seed(0)} if kind is PF else {}
    error, surprise = means(kind(system.model, system.Q, system.R), *run, **options)
    assert inside(error, 2, RUNS)
    assert inside(surprise, 2, RUNS * STEPS)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_the_smoother_is_consistent(kind):
    system, states, u, y, x, P = runs()
    filter = kind(system.model, system.Q, system.R)
    error = nees(*smooth(filter, *record(filter, x, P, y, u), y, u), states)
    assert inside(error.mean().item(), 2, RUNS)


@pytest.mark.parametrize("kind", [EKF, UKF])
@pytest.mark.parametrize("fault", ["a step late", "R too small", "no Q"])
def test_faults_fall_out_of_the_interval(kind, fault):
    system, states, u, y, x, P = runs()
    y = y.roll(1, dims=1) if fault == "a step late" else y
    R = system.R / 4 if fault == "R too small" else system.R
    Q = 1e-6 * system.Q if fault == "no Q" else system.Q
    error, surprise = means(kind(system.model, Q, R), states, u, y, x, P)
    assert not inside(error, 2, RUNS)
    assert not inside(surprise, 2, RUNS * STEPS)


CARS, ARC = 64, 6  # seeds in one batch; steps for an eighth of a circle of radius 1 m


@functools.cache
def infinity():
    """The example's noise on two circles driven open loop: states, observations, inputs."""
    g, car = torch.Generator().manual_seed(1), pp.DubinsCar()
    v = math.pi / 4 / ARC / car.dt
    phi = torch.cat([torch.full((8 * ARC,), v), torch.full((8 * ARC,), -v)])
    u = torch.stack([torch.full_like(phi, v), phi], -1)
    states, y = [torch.tensor([0.0, 0.0, 1.0, 0.0]).expand(CARS, 4)], []
    for i in range(len(u)):
        y.append(states[i] + 0.163 * draw(g, CARS, 4))
        states.append(car.transition(states[i], u[i]) + 0.005 * draw(g, CARS, 4))
    x = states[0] + 0.05 * draw(g, CARS, 4)
    P = (0.05**2 * torch.eye(4)).expand(CARS, 4, 4)
    return torch.stack(states, 1), u.expand(CARS, -1, -1), torch.stack(y, 1), x, P


def test_the_raw_observation_errs_as_the_paper_says():
    states, _, y, *_ = infinity()
    error = (y - states[:, :-1])[..., :2].norm(dim=-1).mean().item()
    assert error == pytest.approx(0.2045, abs=0.003)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind, bound", [(EKF, 0.058), (UKF, 0.058), (PF, 0.065)])
def test_sixty_four_infinities_are_close_and_consistent(kind, bound):
    states, u, y, x, P = infinity()
    eye, options = torch.eye(4), {}
    if kind is PF:
        options["generator"] = torch.Generator().manual_seed(0)
    filter = kind(pp.DubinsCar(), 0.005**2 * eye, 0.163**2 * eye)
    x, P = record(filter, x, P, y, u, **options)
    assert (x - states)[..., :2].norm(dim=-1).mean() < bound
    assert inside(nees(x, P, states).mean().item(), 4, CARS)
    now = x[:, :-1], y, u, P[:, :-1]
    if kind is not PF:  # all innovations of all runs in one call
        surprise = nis(filter.innovation(*now)).mean().item()
        assert inside(surprise, 4, CARS * u.shape[-2])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind, bound", [(EKF, 0.058), (UKF, 0.058), (PF, 0.065)])
def test_cars_that_steer_by_their_estimate_are_close_and_consistent(kind, bound):
    """The book's closed loop, 16 cars in one batch; chapter 5 drives 64."""
    car, g = pp.DubinsCar(), torch.Generator().manual_seed(3)
    options = {"generator": torch.Generator().manual_seed(0)} if kind is PF else {}
    mpc, estimator = pp.infinity.controller(car), functools.partial(kind(car), **options)
    mpc.stepper = pp.utils.ReduceToBason(steps=4)
    start = pp.infinity.waypoints()[0].expand(16, 4)
    world = pp.infinity.SimulatedCar(car, start, 0.005, 0.163, g)
    run = pp.infinity.drive(mpc, world, estimator, steps=60)
    truth = run.x[:, :-1]
    assert run.finished.all()
    assert (run.estimate - truth)[run.running][:, :2].norm(dim=-1).mean() < bound
    assert inside(nees(run.estimate, run.P, truth)[run.running].mean().item(), 4, 16)


@pytest.mark.parametrize("kind", [EKF, UKF])
def test_smoothed_infinities_are_closer_still(kind):
    states, u, y, x, P = infinity()
    filter = kind(pp.DubinsCar(), 0.005**2 * torch.eye(4), 0.163**2 * torch.eye(4))
    x, P = record(filter, x, P, y, u)
    xs, Ps = smooth(filter, x, P, y, u)
    error, smoothed = ((z - states)[..., :2].norm(dim=-1).mean() for z in (x, xs))
    assert smoothed < 0.75 * error
    assert inside(nees(xs, Ps, states).mean().item(), 4, CARS)
