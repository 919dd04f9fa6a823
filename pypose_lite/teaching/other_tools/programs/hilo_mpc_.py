"""HILO-MPC: a model in symbols, weights by name; it needs numpy older than 2."""

import warnings

warnings.simplefilter("ignore")
import casadi
import hilo_mpc
import problem

model = hilo_mpc.Model(discrete=True)
x = model.set_dynamical_states(["i", "j", "c", "s"])
u = model.set_inputs(["v", "phi"])
after = problem.car(x, u, casadi.cos, casadi.sin)
model.set_dynamical_equations(casadi.vertcat(*after))
model.setup(dt=problem.DT)

nmpc = hilo_mpc.NMPC(model)
nmpc.horizon = problem.T
half_state = [w / 2 for w in problem.STATE_WEIGHTS]
half_input = [w / 2 for w in problem.INPUT_WEIGHTS]
names = ["i", "j", "c", "s"]
cost = nmpc.quad_stage_cost
cost.add_states(names=names, ref=problem.TARGET, weights=half_state)
cost.add_inputs(names=["v", "phi"], weights=half_input)
nmpc.set_box_constraints(u_lb=problem.LOWER, u_ub=problem.UPPER)
nmpc.set_initial_guess(x_guess=problem.START, u_guess=[0.0, 0.0])
quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-10}
nmpc.setup(options={"print_level": 0}, solver_options=quiet)


def solve():
    nmpc.optimize(problem.START)
    plan = nmpc.solution["u"]
    return [plan[:, t].full().ravel() for t in range(problem.T)]


problem.report("HILO-MPC", hilo_mpc.__version__, solve)
