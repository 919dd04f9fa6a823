"""What a check gives to an answer: numbers that its reader has not seen."""

import torch
from torch import Tensor


class Given:
    """Draws the numbers of a check, in float64; another seed draws others.

    Seed 0 draws those of the lab, other seeds those of homework, which students have not seen.
    """

    def __init__(self, seed: int = 0) -> None:
        self.seed = seed
        self.generator = torch.Generator().manual_seed(seed)

    def size(self, usual: int) -> int:
        """Returns a number of rows or columns: ``usual`` in the lab, up to two more elsewhere."""
        if self.seed == 0:
            return usual
        return usual + int(torch.randint(3, (), generator=self.generator))

    def randn(self, *shape: int) -> Tensor:
        """Returns independent standard normal numbers."""
        return torch.randn(shape, generator=self.generator, dtype=torch.float64)

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Returns independent numbers between two bounds."""
        numbers = torch.rand(shape, generator=self.generator, dtype=torch.float64)
        return low + (high - low) * numbers

    def positive(self, *shape: int) -> Tensor:
        """Returns symmetric positive definite matrices; ``shape (..., n)`` makes ``(..., n, n)``.

        Their eigenvalues lie between 0.5 and 2, so that no rounding matters.
        """
        axes, _ = torch.linalg.qr(self.randn(*shape, shape[-1]))
        return axes * self.uniform(0.5, 2, *shape).unsqueeze(-2) @ axes.mT
