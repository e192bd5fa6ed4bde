# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rows of results: one for each method and example, as a run stores them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow

# Reason for a missing flow: a newer example replaced this one before its turn, as in the live node.
DROPPED: Final = "dropped: a newer triplet took its place"


@dataclass(frozen=True)
class ResultRow:
    """Result of one method on one example. Every field survives JSON unchanged.

    Attributes:
        recording: Name of the recording.
        number: Index of the sweep in the recording.
        stamp_ns: Stamp of the sweep.
        method: Name of the method.
        num_points: Scored points of the current sweep.
        time_ms: Wall time of the whole estimate, device synchronized; NaN if it failed.
        stage_times_ms: Stage to wall time.
        stop_reasons: Stage to the stop reason of its optimization.
        iterations: Stage to number of steps.
        errors: Group of points (all, dynamic, static) to its errors; empty without truth.
        by_range: Upper limit of a range bin in metres, as text, to its errors.
        by_speed: Upper limit of a bin of true residual speed in m/s, as text, to its errors.
        sums: Group of points of the metrics of Argoverse 2 to number of points, sum of errors and
            sum of motion, see `argoverse_metrics`.
        consistency: Figures without truth: nearest_m (mean distance of the moved points to the next
            sweep), zero_nearest_m (the same for zero flow).
        latency_ms: From the arrival of the next sweep to the flow, in real time; else NaN.
        start: Source of the start weights (warm or cold); empty if the method has none.
        device: `cpu` or `cuda`; empty without a flow.
        failure: Reason for a missing flow in one line; None if there is one.
        movers: Score of the movers, with truth, of methods that detect them; else None.
    """

    recording: str
    number: int
    stamp_ns: int
    method: str
    num_points: int
    time_ms: float = float("nan")
    stage_times_ms: dict[str, float] = field(default_factory=dict)
    stop_reasons: dict[str, str] = field(default_factory=dict)
    iterations: dict[str, int] = field(default_factory=dict)
    errors: dict[str, FlowErrors] = field(default_factory=dict)
    by_range: dict[str, FlowErrors] = field(default_factory=dict)
    by_speed: dict[str, FlowErrors] = field(default_factory=dict)
    sums: dict[str, list[float]] = field(default_factory=dict)
    consistency: dict[str, float] = field(default_factory=dict)
    latency_ms: float = float("nan")
    start: str = ""
    device: str = ""
    failure: str | None = None
    movers: MoverRow | None = None

    @property
    def task(self) -> tuple[str, str]:
        """Recording and method."""
        return self.recording, self.method

    @property
    def badness_m(self) -> float:
        """Figure that sweeps are ranked by, metres: EPE, or without truth the landing distance."""
        errors = self.errors.get("all")
        if errors is not None and errors.num_points > 0:
            return errors.epe_m
        return self.consistency.get("nearest_m", math.nan)

    @property
    def missed_movers(self) -> list[ObjectRow]:
        """True movers that were not found."""
        objects = [] if self.movers is None else self.movers.objects
        return [item for item in objects if item.moves and not item.is_found]

    @property
    def is_dropped(self) -> bool:
        """Whether the example was dropped for a newer one."""
        return self.failure == DROPPED

    @property
    def has_failed(self) -> bool:
        """Whether the method ran and gave no flow."""
        return self.failure not in (None, DROPPED)


@dataclass(frozen=True)
class FinishedTask:
    """End of one method on one recording, and what was noticed.

    Attributes:
        recording: Name of the recording.
        method: Name of the method.
        num_examples: Number of its rows.
        counts: Event to its number.
        damages: Parts that could not be read.
        failure: Why it was given up, in one line; then a resumed run tries again.
    """

    recording: str
    method: str
    num_examples: int = 0
    counts: dict[str, int] = field(default_factory=dict)
    damages: list[str] = field(default_factory=list)
    failure: str | None = None
