"""pypose_lite: the listing of the paper, with bounds."""

import sys

import problem
import torch

import pypose_lite as pp

torch.set_default_dtype(torch.float64)
weights = torch.tensor(problem.STATE_WEIGHTS + problem.INPUT_WEIGHTS)
mpc = pp.MPC(pp.DubinsCar(problem.DT), torch.diag(weights), None, problem.T)
compiled = "compiled" in sys.argv
if compiled:
    mpc.compile()

start = torch.tensor(problem.START)
target = torch.tensor(problem.TARGET)
bounds = {
    "u_lower": torch.tensor(problem.LOWER),
    "u_upper": torch.tensor(problem.UPPER),
}


def solve():
    x, u, cost = mpc(problem.DT, start, target, **bounds)
    return u


name = "pypose_lite, compiled" if compiled else "pypose_lite"
problem.report(name, pp.__version__, solve)
