"""What an estimate gives: the flow, and how it came about."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.core.optimization import OptimizationResult


class Start(Enum):
    """Where an estimate took its first weights from, and if from nowhere, why."""

    WARM = "warm"
    COLD_BY_SETTING = "cold: warm start is off"
    COLD_FIRST = "cold: first triplet"
    COLD_GAP = "cold: gap since the last triplet"
    COLD_TIME_JUMP = "cold: time went back"
    COLD_FRAME = "cold: frame_id changed"
    COLD_LOSS = "cold: the carried fields no longer fit"


@dataclass(frozen=True, eq=False)
class FlowEstimate:
    """The flow of the current sweep of a triplet.

    Attributes:
        flow: (N, 3) float32, metres until the next sweep, one row for each point of the current
            sweep, in its order. point + flow is where that piece of surface is in the next
            sweep's own coordinates, so the flow has the sensor's own motion in it.
        kept: (N,) bool, the points that the fields were fitted to; the others (ground, beyond
            the crop) got their flow from the same fields.
        times_ms: Stage to wall time: prepare, forward, backward, fusion.
        fits: Stage to result of its optimization, for forward, backward and fusion.
        start: Whether the networks were carried over from the last triplet.
        device: Where it was computed, `cpu` or `cuda`.
        distance_kind: `grid` or `tree`; empty for methods that have neither.
    """

    flow: NDArray[np.float32]
    kept: NDArray[np.bool_]
    times_ms: dict[str, float] = field(default_factory=dict)
    fits: dict[str, OptimizationResult] = field(default_factory=dict)
    start: Start = Start.COLD_BY_SETTING
    device: str = "cpu"
    distance_kind: str = ""

    @property
    def time_ms(self) -> float:
        """Wall time of the whole estimate."""
        return sum(self.times_ms.values())

    @property
    def stop_reasons(self) -> dict[str, str]:
        """Stage to the word that says why its optimization ended."""
        return {stage: fit.stop_reason.value for stage, fit in self.fits.items()}


@dataclass
class StageClock:
    """Measures the stages of an estimate; waits for the GPU at the end of each."""

    device: torch.device
    times_ms: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to the stage's time."""
        start = time.perf_counter()
        yield
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        elapsed_ms = (time.perf_counter() - start) * 1e3
        self.times_ms[name] = self.times_ms.get(name, 0.0) + elapsed_ms
