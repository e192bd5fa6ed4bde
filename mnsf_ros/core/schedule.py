"""How much optimization each network of an estimate gets."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from mnsf_ros.settings import Settings

# When each stage has to be done, as a share of the time budget.
_FORWARD_DONE, _BACKWARD_DONE, _FUSION_DONE = 0.4, 0.8, 1.0


@dataclass(frozen=True)
class Schedule:
    """How long to optimize one network, and with which steps.

    Attributes:
        max_iterations: Steps at most.
        learning_rate: Step size at the start.
        decay: Whether the step size falls to zero along a cosine.
        patience: Steps without improvement before it counts as converged; 0: any number.
        min_delta_m: A smaller fall of the loss is no improvement.
        deadline: `time.monotonic()` value after which no further step starts.
        cancelled: Asked before each step; True abandons the estimate.
    """

    max_iterations: int
    learning_rate: float
    decay: bool = False
    patience: int = 0
    min_delta_m: float = 0.0
    deadline: float = math.inf
    cancelled: Callable[[], bool] = lambda: False

    def learning_rate_at(self, iteration: int) -> float:
        """Step size of an iteration, counted from 0."""
        if not self.decay:
            return self.learning_rate
        return self.learning_rate * 0.5 * (1 + math.cos(math.pi * iteration / self.max_iterations))


@dataclass(frozen=True)
class Schedules:
    """The schedules of the three networks of one estimate."""

    forward: Schedule
    backward: Schedule
    fusion: Schedule

    @classmethod
    def start_now(
        cls, settings: Settings, *, is_warm: bool, cancelled: Callable[[], bool]
    ) -> Schedules:
        """The schedules of an estimate whose time budget begins to run now.

        Args:
            settings: Iterations, steps, patience and time budget.
            is_warm: Whether the networks were carried over, so that less is needed.
            cancelled: Asked before each step.
        """
        optimization, fusion, warm = settings.optimization, settings.fusion, settings.warm_start
        budget_s = optimization.time_budget_ms / 1e3 or math.inf
        now = time.monotonic()

        def schedule(max_iterations: int, patience: int, done: float) -> Schedule:
            return Schedule(
                max_iterations=warm.max_iterations if is_warm else max_iterations,
                learning_rate=warm.learning_rate if is_warm else optimization.learning_rate,
                decay=optimization.decay,
                patience=patience,
                min_delta_m=settings.early_stopping.min_delta_m,
                deadline=now + done * budget_s,
                cancelled=cancelled,
            )

        patience = settings.early_stopping.patience
        return cls(
            forward=schedule(optimization.max_iterations, patience, _FORWARD_DONE),
            backward=schedule(optimization.max_iterations, patience, _BACKWARD_DONE),
            fusion=schedule(fusion.max_iterations, fusion.patience, _FUSION_DONE),
        )
