# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rows, one for each estimate, and from them one summary for each method."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum

from mnsf_ros.evaluation.argoverse_metrics import over_all_points
from mnsf_ros.evaluation.metrics import (
    FlowErrors,
    mean,
    means_by_group,
    means_by_limit,
    means_by_name,
)
from mnsf_ros.evaluation.mover_summary import MoverSummary, summarize_movers
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow


class FailureKind(Enum):
    """Why an example has no flow."""

    FAILED = "failed"
    DROPPED = "dropped"


@dataclass(frozen=True)
class Failure:
    """Why there is no flow.

    Attributes:
        kind: Whether the method failed, or a newer triplet took the place of this one.
        text: The reason in one line.
    """

    kind: FailureKind
    text: str

    def __str__(self) -> str:
        """Returns the text."""
        return self.text


# In real time a newer example replaced this one before its turn, as in the live node.
DROPPED = Failure(FailureKind.DROPPED, "dropped: a newer triplet took its place")


@dataclass(frozen=True)
class ResultRow:
    """One method on one example. Everything in it goes into JSON and comes back equal.

    Attributes:
        recording: Name of the recording.
        number: Index of the sweep in the recording.
        stamp_ns: Stamp of the sweep.
        method: Name of the method.
        num_points: Points of the current sweep that the method got.
        time_ms: Wall time of the whole estimate, device synchronized; NaN if it failed.
        stage_times_ms: Stage to wall time.
        stop_reasons: Stage to the reason why its optimization ended.
        iterations: Stage to number of steps.
        errors: Group of points (all, dynamic, static) to its errors; empty without truth.
        error_counts: Points with an error in each bin up to `metrics.ERROR_LIMITS_M`; empty without
            truth, and in runs of early versions.
        by_range: Upper limit of a range band in metres, as text, to its errors.
        by_speed: Upper limit of a band of true residual speed in m/s, as text, to its errors.
        three_way_epe_m: Foreground dynamic, foreground static, background static to EPE.
        bucketed: Class to dynamic normalized and static EPE, after Argoverse 2.
        sums: Group of points of the metrics of Argoverse 2 to number of points, sum of errors and
            sum of motion, from which their means over many examples follow.
        consistency: Figures that need no truth: nearest_m (mean distance of the moved points to
            the next sweep), zero_nearest_m (the same for zero flow), cycle_m (forward-backward
            disagreement where the method has both).
        latency_ms: From the arrival of the next sweep to the flow, in real time; else NaN.
        start: Source of the start weights (warm or cold); empty if the method has none.
        device: Where it was computed, `cpu` or `cuda`; empty if it was not.
        failure: Why there is no flow; None if there is one.
        movers: What was said of movers, with truth, by methods that know what moves; else None.
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
    error_counts: list[int] = field(default_factory=list)
    by_range: dict[str, FlowErrors] = field(default_factory=dict)
    by_speed: dict[str, FlowErrors] = field(default_factory=dict)
    three_way_epe_m: dict[str, float] = field(default_factory=dict)
    bucketed: dict[str, dict[str, float]] = field(default_factory=dict)
    sums: dict[str, list[float]] = field(default_factory=dict)
    consistency: dict[str, float] = field(default_factory=dict)
    latency_ms: float = float("nan")
    start: str = ""
    device: str = ""
    failure: Failure | None = None
    movers: MoverRow | None = None

    @property
    def sweep(self) -> tuple[str, int]:
        """Recording and number of the sweep."""
        return self.recording, self.number

    @property
    def badness_m(self) -> float:
        """How bad the flow is, metres: its error, or without truth the distance it leaves."""
        errors = self.errors.get("all")
        if errors is not None and errors.num_points > 0:
            return errors.epe_m
        return self.consistency.get("nearest_m", math.nan)

    @property
    def missed_movers(self) -> list[ObjectRow]:
        """The movers of the truth that are not called so as a whole."""
        objects = [] if self.movers is None else self.movers.objects
        return [item for item in objects if item.moves and not item.is_found]

    @property
    def is_dropped(self) -> bool:
        """Whether a newer example replaced this one before its turn."""
        return self.failure is not None and self.failure.kind is FailureKind.DROPPED

    @property
    def has_failed(self) -> bool:
        """Whether the method was asked and gave no flow."""
        return self.failure is not None and self.failure.kind is FailureKind.FAILED


@dataclass(frozen=True)
class FinishedTask:
    """What was noticed while one method was run on one recording.

    Attributes:
        recording: Name of the recording.
        method: Name of the method.
        num_examples: Number of its rows; None in runs of early versions.
        counts: Event to how often it happened. Runs of early versions have a sentence there.
        damages: What could not be read.
    """

    recording: str
    method: str
    num_examples: int | None = None
    counts: dict[str, int] = field(default_factory=dict)
    damages: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class MethodSummary:
    """What a method achieved on all of its examples.

    Every value is the mean over examples of the value of each, unless said otherwise; NaN where
    no example has one.

    Attributes:
        method: Name of the method.
        num_examples: Examples that got a flow.
        num_failed: Examples for which the method gave none; they are in no mean.
        num_dropped: Examples that were replaced by newer ones before their turn; likewise.
        errors: Group of points (all, dynamic, static) to errors; empty without truth.
        by_range: Upper limit of a range band in metres to errors.
        by_speed: Upper limit of a band of true residual speed in m/s to errors.
        three_way_epe_m: Foreground dynamic, foreground static, background static to EPE, and
            `mean` of the three. Over all points of all examples, as Argoverse 2 has it.
        bucketed: Class to dynamic normalized and static EPE, and `mean` over the classes. Over
            all points of all examples, likewise.
        consistency: Figures that need no truth, see ResultRow.
        time_ms: Wall time of one estimate.
        latency_ms: From the arrival of a sweep to the flow, where time was played.
        iterations: Stage to number of steps.
        starts: Where estimates took their first weights from, to how often.
        stop_reasons: Why optimizations ended, to how often.
        devices: Where it was computed.
        movers: What was said of movers, over all examples; None where nothing was, or no truth is.
    """

    method: str
    num_examples: int
    num_failed: int = 0
    num_dropped: int = 0
    errors: dict[str, FlowErrors] = field(default_factory=dict)
    by_range: dict[str, FlowErrors] = field(default_factory=dict)
    by_speed: dict[str, FlowErrors] = field(default_factory=dict)
    three_way_epe_m: dict[str, float] = field(default_factory=dict)
    bucketed: dict[str, dict[str, float]] = field(default_factory=dict)
    consistency: dict[str, float] = field(default_factory=dict)
    time_ms: float = math.nan
    latency_ms: float = math.nan
    iterations: dict[str, float] = field(default_factory=dict)
    starts: dict[str, int] = field(default_factory=dict)
    stop_reasons: dict[str, int] = field(default_factory=dict)
    devices: tuple[str, ...] = ()
    movers: MoverSummary | None = None


def summarize(rows: Iterable[ResultRow], methods: Sequence[str] = ()) -> list[MethodSummary]:
    """Returns the summary of each method; those named come first, the others follow by name."""
    by_method: dict[str, list[ResultRow]] = {}
    for row in rows:
        by_method.setdefault(row.method, []).append(row)
    order = [method for method in methods if method in by_method]
    order += sorted(by_method.keys() - set(order))
    return [_summary(method, by_method[method]) for method in order]


def summarize_each(
    rows: Sequence[ResultRow], recordings: Iterable[str], methods: Sequence[str]
) -> dict[str, list[MethodSummary]]:
    """Returns the summaries of each recording alone; those named come first, as of methods."""
    found: dict[str, list[ResultRow]] = {name: [] for name in recordings}
    for row in rows:
        found.setdefault(row.recording, []).append(row)
    return {name: summarize(own, methods) for name, own in found.items()}


def _summary(method: str, rows: list[ResultRow]) -> MethodSummary:
    good = [row for row in rows if row.failure is None]
    num_dropped = sum(row.is_dropped for row in rows)
    three_way_epe_m, bucketed = over_all_points(row.sums for row in good)
    return MethodSummary(
        method=method,
        num_examples=len(good),
        num_failed=len(rows) - len(good) - num_dropped,
        num_dropped=num_dropped,
        errors=means_by_group(row.errors for row in good),
        by_range=means_by_limit(row.by_range for row in good),
        by_speed=means_by_limit(row.by_speed for row in good),
        three_way_epe_m=three_way_epe_m,
        bucketed=bucketed,
        consistency=means_by_name([row.consistency for row in good]),
        time_ms=mean([row.time_ms for row in good]),
        latency_ms=mean([row.latency_ms for row in good]),
        iterations=means_by_name([row.iterations for row in good]),
        starts=dict(Counter(row.start for row in good if row.start)),
        stop_reasons=dict(Counter(word for row in good for word in row.stop_reasons.values())),
        devices=tuple(sorted({row.device for row in good if row.device})),
        movers=summarize_movers(
            (row.recording, row.stamp_ns, row.movers) for row in good if row.movers is not None
        ),
    )
