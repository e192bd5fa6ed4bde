# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sequences of data sets, opened by the name of their format, and written as recordings with truth.

Openers, and the iteration over sweeps, raise a DatasetError if a file is missing or damaged.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name

from mnsf_ros.datasets.formats import FORMATS, TruthSettings
from mnsf_ros.datasets.labelled_sweep import SweepSource
from mnsf_ros.datasets.pseudo_ground_truth import sweep_truth
from mnsf_ros.errors import DatasetError
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth, TrueSweep


def open_source(name: str, source: Path, sequence: str | None = None) -> SweepSource:
    """Opens a sequence of a data set of one of `FORMATS`, by its name if there are several.

    Raises:
        DatasetError: The format has no sequences, or a file is missing or damaged.
    """
    if sequence is not None and not FORMATS[name].has_sequences:
        raise DatasetError(f"format {name!r} takes no sequence")
    opened: SweepSource = resolve_name(f"mnsf_ros.datasets.{FORMATS[name].opener}")(
        source, *filter(None, [sequence])
    )
    return opened


@dataclass
class TruthSummary:
    """Counts of sweeps and points (all, valid, of these dynamic)."""

    num_sweeps: int = 0
    num_points: int = 0
    num_valid: int = 0
    num_dynamic: int = 0

    def add(self, truth: FlowTruth) -> None:
        """Counts one more sweep."""
        self.num_sweeps += 1
        self.num_points += len(truth)
        self.num_valid += int(truth.valid.sum())
        self.num_dynamic += int((truth.valid & truth.dynamic).sum())

    def __str__(self) -> str:
        """Returns one line about the share of points with valid flow."""
        valid = self.num_valid / max(self.num_points, 1)
        dynamic = self.num_dynamic / max(self.num_valid, 1)
        return f"flow of {valid:.1%} of the points is valid, {dynamic:.1%} of these are dynamic"

    @property
    def warning(self) -> str:
        """A warning for the user; may be empty."""
        if self.num_valid:
            return ""
        return (
            "no point has valid flow: no sweep with labels of its stamp has a next sweep "
            "(--unlabelled-static takes all points as static)"
        )


def write_recording(
    source: SweepSource,
    path: Path | str,
    settings: TruthSettings | None = None,
    progress: Callable[[int], None] | None = None,
    *,
    overwrite: bool = False,
) -> TruthSummary:
    """Writes a sequence with its true flow; `progress` gets the number of sweeps done.

    Raises:
        DatasetError: The data set is damaged, or its sweeps are out of order.
        RecordingError: The recording cannot be written.
    """
    settings, summary = settings or TruthSettings(), TruthSummary()
    sweeps = iter(source.sweeps)
    sweep = next(sweeps, None)
    if sweep is None:
        raise DatasetError("the sequence has no sweep there, nothing is written")
    with BagWriter(path, overwrite=overwrite) as writer:
        while sweep is not None:
            following = next(sweeps, None)
            if following is not None and following.stamp_ns <= sweep.stamp_ns:
                raise DatasetError(
                    f"sweeps are out of order: stamp {following.stamp_ns} ns comes after "
                    f"{sweep.stamp_ns} ns"
                )
            truth = sweep_truth(sweep, following, settings)
            true = TrueSweep(sweep.xyz, truth, sweep.columns, sweep.pose)
            writer.write_sweep(true, source.frame_id)
            summary.add(truth)
            if progress is not None:
                progress(summary.num_sweeps)
            sweep = following
    return summary
