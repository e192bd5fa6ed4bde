# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Number and size of the optimization steps of each network of an estimate."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from mnsf_ros.settings import Settings

# Share of the time budget for the fields; the rest is for the fusion.
_FIELDS_DONE = 0.8


@dataclass(frozen=True)
class Schedule:
    """Steps of the optimization of one network.

    Attributes:
        max_iterations: Maximum number of steps.
        learning_rate: Step size at the start.
        decay: Whether the step size falls to zero along a cosine.
        patience: Steps without improvement before it counts as converged; 0: any number.
        min_delta_m: A smaller fall of the loss is no improvement.
        deadline: `time.monotonic()` value after which no further step starts.
        cancelled: Asked before each step; True abandons the estimate.
        records_steps: Whether CUDA may record a step and replay it.
    """

    max_iterations: int
    learning_rate: float
    decay: bool = False
    patience: int = 0
    min_delta_m: float = 0.0
    deadline: float = math.inf
    cancelled: Callable[[], bool] = lambda: False
    records_steps: bool = True

    def learning_rate_at(self, iteration: int) -> float:
        """Step size of an iteration, counted from 0."""
        if not self.decay:
            return self.learning_rate
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * iteration / self.max_iterations))


@dataclass(frozen=True)
class Schedules:
    """The schedules of the networks of one estimate.

    Attributes:
        settings: Iterations, steps, patience and time budget.
        cancelled: Asked before each step.
        started_s: `time.monotonic()` value at which the time budget began to run.
    """

    settings: Settings
    cancelled: Callable[[], bool]
    started_s: float

    @classmethod
    def start_now(cls, settings: Settings, cancelled: Callable[[], bool]) -> Schedules:
        """The schedules of an estimate whose time budget begins to run now."""
        return cls(settings, cancelled, time.monotonic())

    def fields(self, number: int) -> tuple[Schedule, ...]:
        """Of some fields that are fitted one after the other, before the fusion."""
        return tuple(self.field(_FIELDS_DONE * (k + 1) / number) for k in range(number))

    def field(self, done: float = 1.0) -> Schedule:
        """Of one field.

        Args:
            done: Its end as a share of the time budget.
        """
        settings = self.settings
        max_iterations = settings.optimization.max_iterations
        return self._schedule(max_iterations, settings.early_stopping.patience, done)

    @property
    def fusion(self) -> Schedule:
        """Of the fusion, which comes last."""
        fusion = self.settings.fusion
        return self._schedule(fusion.max_iterations, fusion.patience, 1.0)

    def _schedule(self, max_iterations: int, patience: int, done: float) -> Schedule:
        optimization = self.settings.optimization
        return Schedule(
            max_iterations=max_iterations,
            learning_rate=optimization.learning_rate,
            decay=optimization.decay,
            patience=patience,
            min_delta_m=self.settings.early_stopping.min_delta_m,
            deadline=self.started_s + done * (optimization.time_budget_ms / 1e3 or math.inf),
            cancelled=self.cancelled,
            records_steps=self.settings.compute.cuda_graphs,
        )
