"""What an estimate says of movers, beside the truth: points, objects, ghosts, confidence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from online_recordings import TrueSweep

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.kept_points import crop_mask

_CLOSE_M: Final = 0.1
_EDGES: Final = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 1.0001)
# An object counts with so many points, found if half of them are called moving.
_MIN_POINTS: Final = 20
_FOUND_SHARE: Final = 0.5
# Fewer points than this, all of one motion, are no ghost that anybody would see.
_MIN_GHOST_POINTS: Final = 10


@dataclass(frozen=True)
class MoverClass:
    """Movers that one target is about.

    Attributes:
        name: What they are called in the table.
        speeds_m_s: From, to.
        max_range_m: Those farther off do not count.
        first_sweeps: So many sweeps are granted before one must be found.
    """

    name: str
    speeds_m_s: tuple[float, float]
    max_range_m: float
    first_sweeps: int


MOVER_CLASSES: Final = (
    MoverClass("2 m/s and faster, to 50 m", (2.0, 100.0), 50.0, 3),
    MoverClass("0.5 to 2 m/s, to 30 m", (0.5, 2.0), 30.0, 6),
)


@dataclass(eq=False)
class MoverScores:
    """Sums over sweeps.

    Attributes:
        errors_m: Lists of end point errors by part: dynamic and static points.
        points: Number of points called moving in truth moving, wrongly called so, and missed.
        found: Class to object (recording, number) to whether it was found, by sweep.
        ghosts: Number of false movers, by sweep.
        said: Confidence and whether it was deserved, of points called moving.
    """

    errors_m: dict[str, list[NDArray[np.float32]]] = field(
        default_factory=lambda: {"dynamic": [], "static": []}
    )
    points: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))
    found: dict[str, dict[tuple[str, int], dict[int, bool]]] = field(
        default_factory=lambda: {each.name: {} for each in MOVER_CLASSES}
    )
    ghosts: list[int] = field(default_factory=list)
    said: list[NDArray[np.float32]] = field(default_factory=list)

    def add(
        self, recording: str, index: int, current: TrueSweep, next_: TrueSweep, got: FlowEstimate
    ) -> None:
        """Adds the estimate of sweep `index` of a recording."""
        # Including points that were taken for ground, for example the bottoms of vehicles.
        valid = np.flatnonzero(current.scored & crop_mask(current.sweep.xyz, preset("online").crop))
        is_mover, called = current.dynamic[valid], got.over_ground.dynamic[valid]
        errors_m = end_point_errors(got.flow[valid], current.flow[valid])
        self.errors_m["dynamic"].append(errors_m[is_mover])
        self.errors_m["static"].append(errors_m[~is_mover])
        counts = (called & is_mover, called & ~is_mover, ~called & is_mover)
        self.points += [np.count_nonzero(each) for each in counts]
        motions = got.over_ground.motion[valid]
        self.ghosts.append(_num_ghosts(motions[called], is_mover[called]))
        is_close = errors_m[called] < _CLOSE_M
        self.said.append(np.stack([got.over_ground.confidence[valid][called], is_close]))
        self._add_objects(recording, index, current, next_, called, valid)

    def _add_objects(
        self,
        recording: str,
        index: int,
        current: TrueSweep,
        next_: TrueSweep,
        called: NDArray[np.bool_],
        valid: NDArray[np.int64],
    ) -> None:
        interval_s = (next_.sweep.stamp_ns - current.sweep.stamp_ns) / 1e9
        ego_flow = rigid_flow(current.sweep.xyz, np.linalg.inv(next_.pose) @ current.pose)
        speeds = np.linalg.norm(current.flow - ego_flow, axis=1)[valid] / interval_s
        ranges = np.hypot(*current.sweep.xyz[valid, :2].T)
        bodies = current.body[valid]
        for body in np.unique(bodies[current.dynamic[valid]]):
            own = bodies == body
            speed, range_m = np.median(speeds[own]), np.median(ranges[own])
            for each in MOVER_CLASSES:
                low, high = each.speeds_m_s
                if (
                    np.count_nonzero(own) >= _MIN_POINTS
                    and low <= speed < high
                    and range_m <= each.max_range_m
                ):
                    sweeps = self.found[each.name].setdefault((recording, int(body)), {})
                    sweeps[index] = bool(called[own].mean() >= _FOUND_SHARE)

    def epe_m(self, part: str) -> float:
        """Mean end point error of the points of a part."""
        return float(np.concatenate(self.errors_m[part]).mean())

    @property
    def precision(self) -> float:
        """Share of the points called moving that move."""
        return float(self.points[0] / max(1, self.points[0] + self.points[1]))

    @property
    def recall(self) -> float:
        """Share of the moving points that are called so."""
        return float(self.points[0] / max(1, self.points[0] + self.points[2]))

    @property
    def ghosts_per_sweep(self) -> float:
        """Mean number of false movers of a sweep."""
        return float(np.mean(self.ghosts))

    def found_share(self, each: MoverClass) -> tuple[float, int]:
        """Share of mover-sweeps in which the mover was found, after the first; their number."""
        late = [
            is_found
            for sweeps in self.found[each.name].values()
            for index, is_found in sweeps.items()
            if index - min(sweeps) >= each.first_sweeps
        ]
        return (float(np.mean(late)) if late else np.nan), len(late)

    def flicker(self, each: MoverClass) -> float:
        """Share of mover-sweeps in which a mover is lost that was found before and is after."""
        lost = total = 0
        for run in self._runs(each):
            hits = np.flatnonzero(run)
            total += len(run)
            lost += int(hits[-1] - hits[0] + 1 - len(hits)) if len(hits) else 0
        return lost / max(1, total)

    def delay(self, each: MoverClass) -> float:
        """Mean number of sweeps from the first one that shows a mover until it is found.

        One that is never found counts with all its sweeps.
        """
        delays = [int(np.argmax(run)) if any(run) else len(run) for run in self._runs(each)]
        return float(np.mean(delays)) if delays else np.nan

    def calibration(self) -> list[tuple[float, float, float, int]]:
        """Mean confidence, share that deserves it, lower edge and number, of each bin."""
        said, is_close = np.concatenate(self.said, axis=1)
        rows = []
        for low, high in pairwise(_EDGES):
            inside = (said >= low) & (said < high)
            if inside.any():
                mean, share = float(said[inside].mean()), float(is_close[inside].mean())
                rows.append((mean, share, low, int(np.count_nonzero(inside))))
        return rows

    def _runs(self, each: MoverClass) -> Iterator[Sequence[bool]]:
        """Whether it was found, for each mover by sweep."""
        for sweeps in self.found[each.name].values():
            yield [sweeps[index] for index in sorted(sweeps)]


def _num_ghosts(motions: NDArray[np.float32], is_mover: NDArray[np.bool_]) -> int:
    """Number of motions most of whose points stand in truth."""
    if len(motions) == 0:
        return 0
    _, owners = np.unique(motions, axis=0, return_inverse=True)
    owners = owners.ravel()
    counts, false = np.bincount(owners), np.bincount(owners, weights=~is_mover)
    return int(np.count_nonzero((counts >= _MIN_GHOST_POINTS) & (false > counts / 2)))
