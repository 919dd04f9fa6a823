"""Products of small matrices and vectors, for each member of a batch; vectors come last."""

from torch import Tensor


def bmv(mat: Tensor, vec: Tensor) -> Tensor:
    """Batched matrix times vector: ``(..., n, m), (..., m) -> (..., n)``."""
    return mat @ vec if vec.ndim == 1 else (mat @ vec.unsqueeze(-1)).squeeze(-1)


def bvv(lvec: Tensor, rvec: Tensor) -> Tensor:
    """Batched inner product of two vectors: ``(..., n), (..., n) -> (...)``."""
    return (lvec * rvec).sum(-1)


def bvmv(lvec: Tensor, mat: Tensor, rvec: Tensor) -> Tensor:
    """Batched vector times matrix times vector: ``(..., n), (..., n, m), (..., m) -> (...)``."""
    return bvv(lvec, bmv(mat, rvec))


def symmetric(mat: Tensor) -> Tensor:
    """Returns the symmetric part of ``(..., n, n)``, exactly symmetric."""
    return (mat + mat.mT) / 2
