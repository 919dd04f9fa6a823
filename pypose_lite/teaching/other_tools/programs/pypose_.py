"""PyPose: the target moves into the model; bounds are not used."""

import problem
import pypose
import torch

torch.set_default_dtype(torch.float64)
target = torch.tensor(problem.TARGET)


class Car(pypose.module.NLS):
    """The car, its state measured from the target."""

    def state_transition(self, state, input, t=None):
        x = state.squeeze(0) + target
        after = problem.car(x, input.squeeze(0), torch.cos, torch.sin)
        return (torch.stack(after) - target).unsqueeze(0)

    def observation(self, state, input, t=None):
        return state


Q = torch.diag(torch.tensor(problem.STATE_WEIGHTS + problem.INPUT_WEIGHTS))
Q = Q.tile(1, problem.T, 1, 1)
p = torch.zeros(1, problem.T, 6)
start = (torch.tensor(problem.START) - target).unsqueeze(0)


def solve():
    stepper = pypose.utils.ReduceToBason(steps=50)
    mpc = pypose.module.MPC(Car(), Q, p, problem.T, stepper=stepper)
    lower = torch.tensor([problem.LOWER])
    upper = torch.tensor([problem.UPPER])
    x, u, cost = mpc(problem.DT, start, u_lower=lower, u_upper=upper)
    return u[0]


problem.report("PyPose", pypose.__version__, solve)
