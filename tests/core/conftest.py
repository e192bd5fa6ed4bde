"""Devices to run on: the CPU always, CUDA where torch finds it."""

from __future__ import annotations

import pytest


@pytest.fixture(params=["cpu", "cuda"])
def device(request):
    """Where the tensors of a test are."""
    torch = pytest.importorskip("torch")
    if request.param == "cuda" and not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    return torch.device(request.param)


@pytest.fixture
def generator():
    """A source of randomness with a fixed seed."""
    return pytest.importorskip("torch").Generator().manual_seed(0)
