"""do-mpc: a model, then a controller."""

import warnings

warnings.simplefilter("ignore")
import casadi
import do_mpc
import numpy as np
import problem

model = do_mpc.model.Model("discrete")
x = model.set_variable("_x", "x", (4, 1))
u = model.set_variable("_u", "u", (2, 1))
after = problem.car(x, u, casadi.cos, casadi.sin)
model.set_rhs("x", casadi.vertcat(*after))
model.setup()

mpc = do_mpc.controller.MPC(model)
mpc.settings.n_horizon = problem.T
mpc.settings.t_step = problem.DT
mpc.settings.nlpsol_opts = {"ipopt.tol": 1e-10}
mpc.settings.supress_ipopt_output()
away = x - casadi.DM(problem.TARGET)
state_cost = casadi.dot(casadi.DM(problem.STATE_WEIGHTS), away**2) / 2
input_cost = casadi.dot(casadi.DM(problem.INPUT_WEIGHTS), u**2) / 2
mpc.set_objective(lterm=state_cost + input_cost, mterm=casadi.DM(0))
mpc.set_rterm(u=0)  # would price changes of u, not u
mpc.bounds["lower", "_u", "u"] = np.array(problem.LOWER)
mpc.bounds["upper", "_u", "u"] = np.array(problem.UPPER)
mpc.setup()


def solve():
    mpc.reset_history()
    mpc.x0 = np.array(problem.START)
    mpc.u0 = np.zeros(2)
    mpc.set_initial_guess()
    mpc.make_step(np.array(problem.START))
    plan = [mpc.opt_x_num["_u", t, 0] for t in range(problem.T)]
    return [np.array(u).ravel() for u in plan]


problem.report("do-mpc", do_mpc.__version__, solve)
