"""What is written down about one estimate, and about a finished task."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from mnsf_ros.evaluation.metrics import FlowErrors


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
    three_way_epe_m: dict[str, float] = field(default_factory=dict)
    bucketed: dict[str, dict[str, float]] = field(default_factory=dict)
    sums: dict[str, list[float]] = field(default_factory=dict)
    consistency: dict[str, float] = field(default_factory=dict)
    latency_ms: float = float("nan")
    start: str = ""
    device: str = ""
    failure: Failure | None = None

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
