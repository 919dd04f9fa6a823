"""The compiled engine: the same plans, many times faster; no chapter needs it."""

from .optimizer import CompiledOptimizer

__all__ = ["CompiledOptimizer"]
