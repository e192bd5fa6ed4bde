"""Devices to run on, and a street seen from a sensor that moves."""

from __future__ import annotations

import pytest
from moving_sweeps import moving_triplet


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


@pytest.fixture
def translated(make_scene):
    """Five sweeps of a street in which every point has the same flow."""
    return moving_triplet(make_scene(points_per_box=20).current)
