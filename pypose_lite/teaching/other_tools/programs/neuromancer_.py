"""NeuroMANCER: learns a policy, by gradients through the car."""

import sys
import types

# NeuroMANCER imports this service, and does not need it here.
sys.modules.setdefault("wandb", types.ModuleType("wandb"))

import neuromancer
import problem
import torch
from neuromancer.constraint import variable
from neuromancer.loss import PenaltyLoss
from neuromancer.modules import blocks
from neuromancer.problem import Problem
from neuromancer.system import Node, System

torch.manual_seed(0)
torch.set_default_dtype(torch.float64)
network = blocks.MLP(4, 2, hsizes=[32, 32], nonlin=torch.nn.GELU)
policy = Node(network, ["X"], ["U"], name="policy")


def step(x, u):
    after = problem.car(x.unbind(-1), u.unbind(-1), torch.cos, torch.sin)
    return torch.stack(after, dim=-1)


car = Node(step, ["X", "U"], ["X"], name="car")
loop = System([policy, car], nsteps=problem.T)
x = variable("X")
u = variable("U")
state_weights = torch.tensor(problem.STATE_WEIGHTS)
input_weights = torch.tensor(problem.INPUT_WEIGHTS)
target = torch.tensor(problem.TARGET)
away = x[:, :-1, :] - target
# An objective is the mean over all entries: their number makes it a sum.
state_squares = state_weights * away**2
input_squares = input_weights * u**2
state_cost = state_squares.minimize(weight=4 * problem.T / 2, name="state")
input_cost = input_squares.minimize(weight=2 * problem.T / 2, name="input")
below = 1000.0 * (u >= torch.tensor(problem.LOWER))
above = 1000.0 * (u <= torch.tensor(problem.UPPER))
below.name = "below"
above.name = "above"
loss = PenaltyLoss([state_cost, input_cost], [below, above])
learning = Problem([loop], loss)
data = {"X": torch.tensor([[problem.START]]), "name": "train"}


def train(rounds):
    optimizer = torch.optim.Adam(learning.parameters(), lr=0.003)
    for _ in range(rounds):
        optimizer.zero_grad()
        learning(data)["train_loss"].backward()
        optimizer.step()


train(3000)


def solve():
    with torch.no_grad():
        return loop({"X": data["X"]})["U"][0]


problem.report("NeuroMANCER", neuromancer.__version__, solve)
