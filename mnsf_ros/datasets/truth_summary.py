"""How much truth a recording got, and why it may have none."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mnsf_ros.datasets.labelled_sweep import LabelledSweep
    from mnsf_ros.recording.flow_truth import FlowTruth


@dataclass(frozen=True)
class TruthSummary:
    """Counts over sweeps; those of several sweeps can be added.

    Attributes:
        num_sweeps: All sweeps.
        num_posed: Sweeps with a pose.
        num_labelled: Sweeps with boxes, though possibly with no object, or with given flow.
        num_points: All points.
        num_valid: Points with valid flow.
        num_dynamic: Points with valid flow that move by themselves.
    """

    num_sweeps: int = 0
    num_posed: int = 0
    num_labelled: int = 0
    num_points: int = 0
    num_valid: int = 0
    num_dynamic: int = 0

    @classmethod
    def of_sweep(cls, sweep: LabelledSweep, truth: FlowTruth) -> TruthSummary:
        """Counts one sweep."""
        return cls(
            num_sweeps=1,
            num_posed=int(sweep.pose is not None),
            num_labelled=int(sweep.boxes is not None or sweep.given is not None),
            num_points=len(sweep),
            num_valid=int(truth.valid.sum()),
            num_dynamic=int((truth.valid & truth.dynamic).sum()),
        )

    def __add__(self, other: TruthSummary) -> TruthSummary:
        """Counts the sweeps of both."""
        pairs = zip(astuple(self), astuple(other), strict=True)
        return TruthSummary(*(one + another for one, another in pairs))

    def __str__(self) -> str:
        """Returns one line about the share of points whose flow is known."""
        valid = self.num_valid / max(self.num_points, 1)
        dynamic = self.num_dynamic / max(self.num_valid, 1)
        return f"flow of {valid:.1%} of the points is valid, {dynamic:.1%} of these are dynamic"

    def warnings(self) -> Iterator[str]:
        """Yields a line about each thing that may not be as the user expects."""
        if not self.num_valid:
            yield f"no point has valid flow: {self._why_nothing_is_valid()}"
        if 0 < self.num_posed < self.num_sweeps:
            yield (
                f"{self.num_posed} of {self.num_sweeps} sweeps have a pose, the odometry lacks "
                "the others"
            )

    def _why_nothing_is_valid(self) -> str:
        if self.num_sweeps == 1:
            return "a single sweep has no next one"
        if not self.num_labelled:
            return (
                "no sweep has labels; either there are none, or their stamps are not those of "
                "the sweeps (--unlabelled-static takes everything as standing still)"
            )
        return "labels reach no point of a sweep that has a next one"
