# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A small street whose true flow is known; what needs PyTorch is skipped where there is none."""

import importlib.util
import os
import signal
from dataclasses import dataclass

import numpy as np
import pytest
from ros_domain import reserve_domain

# Read by torch when it is imported. With more threads than idle cores, small networks take 50
# times as long, because the threads wait for each other after every layer.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# In the background of a shell SIGINT is ignored, and processes started from here would inherit it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

NEEDS_TORCH = ("No module named 'torch'", "library 'torch' is not installed")


@pytest.hookimpl(hookwrapper=True)
def pytest_make_collect_report(collector):
    """Modules that import PyTorch are skipped where it is not installed: it is optional."""
    report = (yield).get_result()
    _skip_without_torch(report, str(collector.path))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item):
    """Tests that end because there is no PyTorch are skipped."""
    report = (yield).get_result()
    _skip_without_torch(report, str(item.path))


def _skip_without_torch(report, path):
    is_missing = importlib.util.find_spec("torch") is None
    if report.failed and is_missing and any(text in str(report.longrepr) for text in NEEDS_TORCH):
        report.outcome, report.longrepr = "skipped", (path, 0, "needs PyTorch")


@dataclass(frozen=True)
class Scene:
    """Three sweeps (N, 3) float32 metres, shuffled, so that rows do not correspond.

    `flow` (N, 3) is the true flow of `current`, `moving` (N,) says which points it moves.
    """

    previous: np.ndarray
    current: np.ndarray
    next: np.ndarray
    flow: np.ndarray
    moving: np.ndarray


def _box(rng, center, size, num_points):
    """Points on the walls and the roof of a box."""
    points = rng.uniform(-0.5, 0.5, (num_points, 3))
    rows, axes = np.arange(num_points), rng.choice(3, num_points, p=(0.4, 0.4, 0.2))
    points[rows, axes] = np.where(axes == 2, 0.5, np.copysign(0.5, points[rows, axes]))
    return points * size + center


def build_scene(motion=(0.5, 0.2, 0.0), seed=0, points_per_box=60):
    """Ground at -1.8 m, four parked boxes, one box that moves by `motion` from sweep to sweep."""
    rng = np.random.default_rng(seed)
    size = (4.0, 1.8, 1.5)
    parked = [(12, 6, -1.05), (-12, 6, -1.05), (12, -7, -1.05), (-10, -8, -1.05)]
    ground = np.stack(np.meshgrid(np.arange(-20, 21, 2), np.arange(-15, 16, 2), -1.8), -1)
    still = np.vstack(
        [ground.reshape(-1, 3), *(_box(rng, center, size, points_per_box) for center in parked)]
    )
    mover = _box(rng, (5, 0, -1.05), size, points_per_box)
    rest = np.zeros_like(still)
    motions = np.vstack([rest, np.broadcast_to(motion, mover.shape)]).astype(np.float32)
    current = np.vstack([still, mover]).astype(np.float32)
    order = rng.permutation(len(current))
    return Scene(
        previous=rng.permutation(current - motions),
        current=current[order],
        next=rng.permutation(current + motions),
        flow=motions[order],
        moving=order >= len(still),
    )


@pytest.fixture
def make_scene():
    """`build_scene`: synthetic sweeps with known flow."""
    return build_scene


@pytest.fixture(scope="session")
def make_street(tmp_path_factory):
    """Returns the recording of a simulated street, which is made once for each settings."""
    from mnsf_ros.simulation.recording import write_recording
    from mnsf_ros.simulation.settings import SimulationSettings

    made = {}

    def make(seed=1, duration_s=0.5, num_beams=16, num_columns=256):
        settings = SimulationSettings(
            seed=seed, duration_s=duration_s, num_beams=num_beams, num_columns=num_columns
        )
        if settings not in made:
            made[settings] = tmp_path_factory.mktemp("recordings") / "street"
            write_recording(settings, made[settings])
        return made[settings]

    return make


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
def own_domain(monkeypatch, tmp_path):
    """Everything that a test starts meets in a ROS domain of its own."""
    domain, lock = reserve_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    yield
    lock.close()


@pytest.fixture
def without_drawing(monkeypatch):
    """Charts and pictures are empty: to draw them takes longer than all the rest of a run."""
    for name in ("drawing.charts.png_bytes", "evaluation.pictures.frame"):
        monkeypatch.setattr(f"mnsf_ros.{name}", lambda *_, **__: b"PNG")
