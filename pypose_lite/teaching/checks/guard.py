"""Keeps an answer from changing anything that others rely on, and from printing."""

import builtins
import contextlib
import io
import random
import sys
import warnings
from collections.abc import Iterator

import numpy
import torch


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Runs its block with float64, gradients and silence, and puts everything back afterwards.

    That is: the default dtype and grad mode of torch, the generators of torch, numpy and Python,
    numpy's treatment of errors, warnings, matplotlib's rcParams, builtins, and what is printed.
    """
    with contextlib.ExitStack() as stack:
        stack.callback(torch.set_default_dtype, torch.get_default_dtype())
        stack.callback(torch.set_grad_enabled, torch.is_grad_enabled())
        stack.callback(torch.set_rng_state, torch.get_rng_state())
        stack.callback(numpy.random.set_state, numpy.random.get_state())
        stack.callback(random.setstate, random.getstate())
        stack.callback(vars(builtins).update, dict(vars(builtins)))
        stack.enter_context(numpy.errstate())
        stack.enter_context(warnings.catch_warnings())
        if "matplotlib" in sys.modules:
            stack.enter_context(sys.modules["matplotlib"].rc_context())
        stack.enter_context(silence())
        warnings.simplefilter("ignore")
        torch.set_default_dtype(torch.float64)
        torch.set_grad_enabled(True)
        yield


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Drops what its block prints or displays, however much that is."""
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stdout(_Nowhere()))
        stack.enter_context(contextlib.redirect_stderr(_Nowhere()))
        if "IPython" in sys.modules and sys.modules["IPython"].get_ipython():
            from IPython.utils.capture import capture_output

            stack.enter_context(capture_output(stdout=False, stderr=False, display=True))
        yield


class _Nowhere(io.TextIOBase):
    """A file that keeps nothing."""

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        return len(text)
