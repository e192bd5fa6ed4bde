# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Halves of recordings, on which settings are chosen and judged, and their cost with true flow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import pandas as pd

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import EvaluationError, MnsfError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.scoring import failed_row, scored_row
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.online.stream import Stream
from mnsf_ros.settings import Settings

METHOD: Final = "online"
# Added for the share of examples without a flow, so that settings cannot win by failing.
FAILURE_COST: Final = 1.0

Estimate = tuple[Example, FlowEstimate | None]


@dataclass(frozen=True, eq=False)
class Half:
    """One half of each recording.

    Attributes:
        stretches: For each recording, its examples in order.
    """

    stretches: tuple[tuple[Example, ...], ...]

    @property
    def num_examples(self) -> int:
        """Number of examples in all."""
        return sum(map(len, self.stretches))

    def estimated(self, settings: Settings) -> Iterator[Iterator[Estimate]]:
        """Yields, for each recording, its examples with their estimates; None where it fails."""
        return (_estimated(stretch, settings) for stretch in self.stretches)


def _estimated(stretch: Sequence[Example], settings: Settings) -> Iterator[Estimate]:
    stream = Stream(settings, METHOD)
    for example in stretch:
        try:
            yield example, stream.flow_of(example.triplet)
        except MnsfError:
            yield example, None


def read_halves(
    recordings: Sequence[EvaluatedRecording], options: EvaluationOptions, max_examples: int
) -> tuple[Half, Half]:
    """Reads the first examples of both halves of each recording; no sweep is in both.

    The points that are scored are those of `options`, whatever settings are tried later: settings
    cannot win by leaving out what is difficult.

    Raises:
        EvaluationError: A half of all recordings has no example.
        MnsfError: A recording cannot be read.
    """
    pairs = [_halves_of(recording, options, max_examples) for recording in recordings]
    first, second = (Half(tuple(stretches)) for stretches in zip(*pairs, strict=True))
    if not (first.num_examples and second.num_examples):
        names = ", ".join(recording.name for recording in recordings)
        raise EvaluationError(
            f"{names}: too short to tune on one half and judge on the other; each half needs "
            "three consecutive sweeps"
        )
    return first, second


def _halves_of(
    recording: EvaluatedRecording, options: EvaluationOptions, max_examples: int
) -> tuple[tuple[Example, ...], tuple[Example, ...]]:
    middle = recording.num_sweeps // 2
    first: list[Example] = []
    second: list[Example] = []
    with recording.open() as reader:
        for example in read_examples(reader, recording, options, Findings()):
            # The current sweep has one before it and one after it.
            if example.number + 1 < middle and len(first) < max_examples:
                first.append(example)
            elif example.number - 1 >= middle:
                second.append(example)
                if len(second) == max_examples:
                    break
    return tuple(first), tuple(second)


class LabelledJudge:
    """Judges settings by the three-way EPE of a half with true flow."""

    goal: Final = "three-way EPE (m)"

    def __init__(self, half: Half) -> None:
        self._half = half

    def __call__(self, settings: Settings) -> float:
        """Estimates and scores all examples; returns the cost, lower is better."""
        summary = self.summary(settings)
        epe_m = float(summary.get("three_way.mean", math.nan))
        failed = float(summary["num_failed"]) / self._half.num_examples
        return math.inf if math.isnan(epe_m) else epe_m + FAILURE_COST * failed

    def summary(self, settings: Settings) -> pd.Series:
        """Returns the summary that `mnsf evaluate` would give of these examples alone."""
        rows = [_row(*pair) for stretch in self._half.estimated(settings) for pair in stretch]
        return summarize(rows).loc[METHOD]


def _row(example: Example, estimate: FlowEstimate | None) -> ResultRow:
    if estimate is None:
        return failed_row(example, METHOD, "no flow")
    return scored_row(example, METHOD, estimate, estimate.time_ms)
