"""A cost and a limit on how fast the inputs change, by a longer state.

What `du` is often mistaken for: that bounds how far one sweep may move, not the plan.
"""

import torch
from torch import Tensor

from ..linalg import symmetric
from ..shapes import check
from ..systems import NLS, System


class InputRates(NLS):
    """A system whose state remembers the last input, and whose input is the change of it.

        u_t = u_t-1 + du_t                          (1)
        [x, u]_t+1 = [f(x_t, u_t, t), u_t]          (2)

    The observation is the system's own, ``g(x_t, u_t, t)``. The clock is this system's.
    """

    vectorized = True

    def __init__(self, system: System, inputs: int):
        super().__init__()
        self.system, self.inputs = system, inputs
        if hasattr(system, "dt"):
            self.dt = system.dt

    def state_transition(self, state, input, t=None):
        """Returns the next state and the input that led there, ``(..., n+m)``."""
        x, u = self._now(state, input)
        moved = self.system.transition(x, u, t.squeeze(-1) if t.ndim else t)
        return torch.cat([moved, u.expand(*moved.shape[:-1], -1)], -1)  # (2)

    def observation(self, state, input, t=None):
        """Returns what the system shows, ``(..., p)``."""
        return self.system.observe(*self._now(state, input), t.squeeze(-1) if t.ndim else t)

    def _now(self, state: Tensor, input: Tensor) -> tuple[Tensor, Tensor]:
        n = state.shape[-1] - self.inputs
        return state[..., :n], state[..., n:] + input  # (1)


def input_rates(system: System, Q: Tensor, S: Tensor) -> tuple[InputRates, Tensor]:
    """Returns a system and weights that make changes of the input cost ``1/2 du' S du``.

    Give both to `LQR` or `MPC`. States are then ``[x, u_last]``, targets ``[target, u_target]``,
    inputs are changes ``du``: a bound on them limits the rate. Bounds of u itself become bounds of
    a state, which this library does not have; weigh u instead.

    Args:
        system: any :class:`System`.
        Q: its weights of ``z = [x, u]``, ``(..., n+m, n+m)``.
        S: weights of the change of u in one step, ``(m, m)``, symmetric > 0.

    Raises:
        ValueError: for weights that do not fit together.

    Source: Maciejowski, "Predictive Control with Constraints" (2002), section 2.4.
    """
    sizes = check("Q: k k, S: m m", Q, S)
    k, m = sizes["k"], sizes["m"]
    if k <= m:
        raise ValueError(f"S: expected fewer inputs than Q has rows, {k}, got {m}")
    eye = torch.eye(k, dtype=Q.dtype, device=Q.device)
    M = torch.cat([eye, eye[:, k - m :]], -1)  # [x, u] = M [x, u_last, du]
    weights = M.mT @ symmetric(Q) @ M
    weights = weights + torch.nn.functional.pad(symmetric(S), (k, 0, k, 0))
    return InputRates(system, m), weights
