# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Run times of the stages of an estimate, and its end where its caller asks for it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from mnsf_ros.errors import CancelledError


def check_cancelled(cancelled: Callable[[], bool]) -> None:
    """Ends an estimate if its caller asked for it.

    Raises:
        CancelledError: If `cancelled` returns True.
    """
    if cancelled():
        raise CancelledError("the estimate was cancelled")


@dataclass
class StageClock:
    """Measures the stages of an estimate, and ends it before one if the caller asked for it.

    Attributes:
        cancelled: Asked before each stage.
        finish: Called at the end of each stage, to wait for a GPU.
        times_ms: Stage to wall time.
    """

    cancelled: Callable[[], bool] = lambda: False
    finish: Callable[[], None] = lambda: None
    times_ms: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds the time of the block to the stage's time.

        Raises:
            CancelledError: If `cancelled` returns True.
        """
        check_cancelled(self.cancelled)
        start = time.perf_counter()
        yield
        self.finish()
        elapsed_ms = (time.perf_counter() - start) * 1e3
        self.times_ms[name] = self.times_ms.get(name, 0.0) + elapsed_ms
