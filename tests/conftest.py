"""Fixtures that the tests of the core share."""

import pytest
import torch


@pytest.fixture
def float64():
    """Lets a file's tests say ``torch.eye(2)`` and mean float64."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(before)


@pytest.fixture
def g():
    """A seeded generator: every test draws the same numbers, whatever ran before it."""
    return torch.Generator().manual_seed(0)
