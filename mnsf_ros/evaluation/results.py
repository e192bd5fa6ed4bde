"""From rows to one summary per method: the figures of the tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from mnsf_ros.evaluation.argoverse_metrics import added, bucketed_errors, three_way_epe_m
from mnsf_ros.evaluation.metrics import FlowErrors, mean_of
from mnsf_ros.evaluation.result_row import ResultRow


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


def summarize(rows: Iterable[ResultRow], methods: Sequence[str] = ()) -> list[MethodSummary]:
    """Returns the summary of each method.

    Args:
        rows: Rows of any number of recordings and methods, in any order.
        methods: Which come first, in this order; the others follow by name.
    """
    by_method: dict[str, list[ResultRow]] = {}
    for row in rows:
        by_method.setdefault(row.method, []).append(row)
    order = [method for method in methods if method in by_method]
    order += sorted(by_method.keys() - set(order))
    return [_summary(method, by_method[method]) for method in order]


def _summary(method: str, rows: list[ResultRow]) -> MethodSummary:
    good = [row for row in rows if row.failure is None]
    num_dropped = sum(row.is_dropped for row in rows)
    sums = added(row.sums for row in good)
    three_way = three_way_epe_m(sums) if sums else {}
    return MethodSummary(
        method=method,
        num_examples=len(good),
        num_failed=len(rows) - len(good) - num_dropped,
        num_dropped=num_dropped,
        errors=_mean_errors(good, lambda row: row.errors),
        by_range=_by_limit(_mean_errors(good, lambda row: row.by_range)),
        by_speed=_by_limit(_mean_errors(good, lambda row: row.by_speed)),
        three_way_epe_m=_with_mean(three_way),
        bucketed=_with_class_mean(bucketed_errors(sums)),
        consistency=_means([row.consistency for row in good]),
        time_ms=mean([row.time_ms for row in good]),
        latency_ms=mean([row.latency_ms for row in good]),
        iterations=_means([row.iterations for row in good]),
        starts=dict(Counter(row.start for row in good if row.start)),
        stop_reasons=dict(Counter(word for row in good for word in row.stop_reasons.values())),
        devices=tuple(sorted({row.device for row in good if row.device})),
    )


def mean(values: Sequence[float]) -> float:
    """Returns the mean of the values that are numbers; NaN if there are none."""
    numbers = [value for value in values if not math.isnan(value)]
    return math.fsum(numbers) / len(numbers) if numbers else math.nan


def _mean_errors(
    rows: list[ResultRow], part: Callable[[ResultRow], dict[str, FlowErrors]]
) -> dict[str, FlowErrors]:
    groups: dict[str, list[FlowErrors]] = {}
    for row in rows:
        for name, errors in part(row).items():
            groups.setdefault(name, []).append(errors)
    return {name: mean_of(errors) for name, errors in groups.items()}


def _by_limit(errors: dict[str, FlowErrors]) -> dict[str, FlowErrors]:
    return {name: errors[name] for name in sorted(errors, key=float)}


def _means(parts: Sequence[dict[str, float]] | Sequence[dict[str, int]]) -> dict[str, float]:
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: mean([part[name] for part in parts if name in part]) for name in names}


def _with_mean(values: dict[str, float]) -> dict[str, float]:
    if not values:
        return {}
    # Of a recording without one of the groups there is no such mean.
    return {**values, "mean": math.fsum(values.values()) / len(values)}


def _with_class_mean(classes: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    if not classes:
        return {}
    kinds = next(iter(classes.values()))
    means = {kind: mean([errors[kind] for errors in classes.values()]) for kind in kinds}
    return {**classes, "mean": means}
