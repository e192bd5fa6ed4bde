# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Four moments of KITTI raw drive 0005: as the authors' triplets of 8,192 points, and in full.

The triplets are npz files in the layout of the authors of FNSF and MNSF: pc1, pc2, pc3 (N, 3) and
flow23 (N, 3) in metres, without ground and cropped to 80 m and 4 m of height, and here also
is_dynamic and label_valid (N,). Their points are some of the full sweeps in the folder beside
them, which know their poses, too. Full examples are those sweeps with the same crop, without what
their own flag calls ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from online_recordings import DATA

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.evaluation.metrics import FlowErrors, by_motion, flow_errors
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

MOMENTS = (5, 10, 15, 20)
FEW, FULL = "8192", "full"
SCALES = (FEW, FULL)

_NUM_POINTS = 8192
_MAX_RANGE_M, _MAX_HEIGHT_M = 80.0, 4.0

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class KittiExample:
    """A triplet with the true flow of its current sweep.

    Attributes:
        triplet: Sweeps without ground, with two earlier ones and the motion of the sensor.
        flow: (N, 3) metres until the next sweep.
        dynamic: (N,) bool, the point moves by itself.
        labelled: (N,) bool, movers were labelled there at all; elsewhere they count as static.
    """

    triplet: SweepTriplet
    flow: NDArray[np.float32]
    dynamic: NDArray[np.bool_]
    labelled: NDArray[np.bool_]

    def errors(self, estimate: FlowEstimate) -> dict[str, FlowErrors]:
        """Errors over all points, and over labelled ones that move by themselves or do not."""
        parts = by_motion(estimate.flow, self.flow, self.dynamic, self.labelled)
        return parts | {"all": flow_errors(estimate.flow, self.flow)}


def missing_data() -> str:
    """Says what is not there, empty if all is."""
    files = [_triplet_file(moment) for moment in MOMENTS]
    files += [_sweep_file(moment + k) for moment in MOMENTS for k in (1, 0, -1, -2, -3)]
    missing = [str(file) for file in files if not file.is_file()]
    return f"{len(missing)} files are not there, the first is {missing[0]}" if missing else ""


def read_example(scale: str, moment: int) -> KittiExample:
    """Returns the example whose current sweep has this number.

    Args:
        scale: One of `SCALES`.
        moment: One of `MOMENTS`.
    """
    files = [_sweep_file(moment + k) for k in (1, 0, -1, -2, -3)]
    following, current, previous, *earlier = (_read(file) for file in files)
    next_from_current = np.linalg.inv(following["pose"]) @ current["pose"]
    if scale == FULL:
        triplet = SweepTriplet(
            *(_sweep(item, item["xyz"][_kept(item)]) for item in (previous, current, following)),
            tuple(_sweep(item, item["xyz"][_kept(item)]) for item in earlier),
            next_from_current,
        )
        kept = _kept(current)
        truth = (current[name][kept] for name in ("flow", "is_dynamic", "label_valid"))
        return KittiExample(triplet, *truth)
    arrays = _read(_triplet_file(moment))
    of_triplet = zip((previous, current, following), ("pc1", "pc2", "pc3"), strict=True)
    # The triplets have three sweeps; those before are drawn from the full ones, as those were.
    rng = np.random.default_rng(0)
    triplet = SweepTriplet(
        *(_sweep(item, arrays[name]) for item, name in of_triplet),
        tuple(_sweep(item, _some_points(item, rng)) for item in earlier),
        next_from_current,
    )
    return KittiExample(triplet, arrays["flow23"], arrays["is_dynamic"], arrays["label_valid"])


def _sweep(arrays: Arrays, xyz: NDArray[np.float32]) -> Sweep:
    return Sweep.from_array(xyz, stamp_ns=int(arrays["stamp_ns"]), frame_id="lidar")


def _kept(sweep: Arrays) -> NDArray[np.bool_]:
    xyz = sweep["xyz"]
    near = (np.hypot(xyz[:, 0], xyz[:, 1]) <= _MAX_RANGE_M) & (xyz[:, 2] <= _MAX_HEIGHT_M)
    kept: NDArray[np.bool_] = near & ~sweep["is_ground"]
    return kept


def _some_points(sweep: Arrays, rng: np.random.Generator) -> NDArray[np.float32]:
    rows = rng.choice(np.flatnonzero(_kept(sweep)), _NUM_POINTS, replace=False)
    points: NDArray[np.float32] = sweep["xyz"][rows]
    return points


def _read(file: Path) -> Arrays:
    with np.load(file) as content:
        return dict(content)


def _triplet_file(moment: int) -> Path:
    return DATA / "triplets" / f"kitti_0005_{moment:03d}_{_NUM_POINTS}.npz"


def _sweep_file(number: int) -> Path:
    return DATA / "kitti_0005" / f"sweep_{number:03d}.npz"
