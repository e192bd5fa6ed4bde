"""Devices to run on: the CPU always, CUDA where torch finds it."""

from __future__ import annotations

import pytest
import torch

CUDA = pytest.param(
    "cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
)


@pytest.fixture(params=["cpu", CUDA])
def device(request):
    """Where the tensors of a test are."""
    return torch.device(request.param)


@pytest.fixture
def generator():
    """A source of randomness with a fixed seed."""
    return torch.Generator().manual_seed(0)
