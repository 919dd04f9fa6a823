"""Answers to lab 7, as students give them: tuning, differentiating, walking and buying."""

import numpy as np
import torch
from graders import right, wrong

import pypose_lite as pp
from pypose_lite import infinity

car = pp.DubinsCar(0.1)

# --- 7.5

right("7.5")((0.3, 0.0005))
right("7.5")(torch.tensor([0.305, 0.0008]))
right("7.5")([np.float32(0.298), 1e-4])
wrong("7.5", "A slower car is always closer", "the chapter's")((0.25, 0.001))
wrong("7.5", "Make u cheaper", "chapter 3's price")((0.3, 0.01))
wrong("7.5", "Make u cheaper", "three times")((0.3, 0.003))
wrong("7.5", "faster than it has to be", "in a hurry")((0.36, 0.0003))
wrong("7.5", "Some cars lose their plan", "far too fast")((0.45, 0.01))
wrong("7.5", "First the spacing", "swapped")((0.0005, 0.3))
wrong("7.5", "2 results", "one number")(0.3)

# --- 7.6


def run_of(log_price, cars=8, steps=12, seed=0, weights=None, sweeps=None, aim=None):
    price = log_price.exp()
    if weights is None:
        weights = torch.cat([torch.tensor([1, 1, 0.3, 0.3]), price.expand(2)])
    stepper = None if sweeps is None else pp.utils.ReduceToBason(steps=sweeps)
    mpc = pp.MPC(car, weights.diag(), None, 10, stepper)
    generator = torch.Generator().manual_seed(seed)
    noise = infinity.PROCESS_NOISE, infinity.OBSERVATION_NOISE
    path = infinity.waypoints()
    world = infinity.SimulatedCar(car, path[0].expand(cars, 4), *noise, generator)

    def ahead(x, goal):
        return pp.local_plan(x, path, goal, 0.25, count=10)

    return infinity.drive(mpc, world, pp.EKF(car), aim or ahead, 0.3, steps)


def root_mean_square(x):
    return infinity.tracking_error(x).square().mean().sqrt()


@right("7.6")
def by_stacking(log_price):
    one, some = torch.tensor(1.0), torch.tensor(0.3)
    weights = torch.stack([one, one, some, some, log_price.exp(), log_price.exp()])
    return root_mean_square(run_of(log_price, weights=weights).x)


@right("7.6")
def by_the_norm(log_price):
    error = infinity.tracking_error(run_of(log_price).x)
    return error.norm() / error.numel() ** 0.5


@wrong("7.6", "cuts the graph")
def a_new_tensor(log_price):
    price = log_price.exp().item()
    weights = torch.tensor([1, 1, 0.3, 0.3, price, price])
    return root_mean_square(run_of(log_price, weights=weights).x)


@wrong("7.6", "take the root of the mean of squares")
def mean_distance(log_price):
    return infinity.tracking_error(run_of(log_price).x).mean()


@wrong("7.6", "take its root")
def mean_square(log_price):
    return infinity.tracking_error(run_of(log_price).x).square().mean()


@wrong("7.6", "8 cars, 12 steps")
def sixteen_steps(log_price):
    return root_mean_square(run_of(log_price, steps=16).x)


@wrong("7.6", "8 cars, 12 steps")
def another_seed(log_price):
    return root_mean_square(run_of(log_price, seed=1).x)


@wrong("7.6", "cut out of the graph")
def a_detached_plan(log_price):
    def aim(x, goal):
        return pp.local_plan(x.detach(), infinity.waypoints(), goal, 0.25, count=10)

    return root_mean_square(run_of(log_price, aim=aim).x)


@wrong("7.6", "8 cars, 12 steps")
def the_price_itself(log_price):
    return root_mean_square(run_of(log_price.exp()).x)


# --- 7.7

right("7.7")((0.1, 0.01))
right("7.7")(torch.tensor([0.105, 0.012]))
wrong("7.7", "inputs are free", "the chapter's price")((0.1, 0.001))
wrong("7.7", "may be longer", "slow")((0.08, 0.01))
wrong("7.7", "can be in a curve", "at the limit")((0.12, 0.01))
wrong("7.7", "inputs are free", "fast, and cheap")((0.11, 0.0005))
wrong("7.7", "First the spacing", "swapped")((0.01, 0.1))

# --- 7.8

right("7.8", "as the solution")({"sensor": 0.02, "filter": False, "plan": True})
right("7.8", "in another order")({"plan": True, "sensor": 0.02, "filter": False})
wrong("7.8", "estimation is a small part", "sensor alone")(
    {"sensor": 0.02, "filter": False, "plan": False}
)
wrong("7.8", "Leave something out", "everything")({"sensor": 0.02, "filter": True, "plan": True})
wrong("7.8", "the largest here", "the usual")({"sensor": 0.163, "filter": True, "plan": True})
wrong("7.8", "the largest here", "for ten points")({"sensor": 0.08, "filter": True, "plan": True})
wrong("7.8", "need first", "no filter")({"sensor": 0.163, "filter": False, "plan": True})
wrong("7.8", "one of the sensors", "no such sensor")({"sensor": 0.1, "filter": True, "plan": True})
wrong("7.8", "True or False", "a number")({"sensor": 0.02, "filter": 0, "plan": 1})
