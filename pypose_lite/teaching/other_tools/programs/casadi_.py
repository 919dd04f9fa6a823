"""CasADi: variables, constraints and a cost in symbols, handed to a solver."""

import sys

import casadi
import problem

solver = sys.argv[1]  # "ipopt" or "fatrop"
opti = casadi.Opti()
X = []
U = []
for _ in range(problem.T):
    X.append(opti.variable(4))
    U.append(opti.variable(2))
X.append(opti.variable(4))

cost = 0
for t in range(problem.T):
    after = problem.car(X[t], U[t], casadi.cos, casadi.sin)
    opti.subject_to(X[t + 1] == casadi.vertcat(*after))
    if t == 0:
        opti.subject_to(X[0] == problem.START)
    opti.subject_to(opti.bounded(problem.LOWER, U[t], problem.UPPER))
    away = X[t] - casadi.DM(problem.TARGET)
    cost += casadi.dot(casadi.DM(problem.STATE_WEIGHTS), away**2) / 2
    cost += casadi.dot(casadi.DM(problem.INPUT_WEIGHTS), U[t] ** 2) / 2
opti.minimize(cost)
if solver == "ipopt":
    quiet = {"print_level": 0, "sb": "yes", "tol": 1e-10}
    opti.solver("ipopt", {"print_time": False}, quiet)
else:
    find_steps = {"expand": True, "structure_detection": "auto"}
    quiet = {"print_level": 0, "tol": 1e-10}
    opti.solver("fatrop", find_steps | {"print_time": False}, quiet)


def solve():
    for x in X:
        opti.set_initial(x, problem.START)
    for u in U:
        opti.set_initial(u, 0)
    solution = opti.solve()
    return [solution.value(u) for u in U]


problem.report(f"CasADi, {solver}", casadi.__version__, solve)
