# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Errors of `online` and `neural` beside FNSF, MNSF and ego motion alone, on the same sweeps.

    python benchmarks/accuracy.py [--quick] [--document FILE]

On KITTI 0005, if the shared data is there (see drives.py), and on three simulated streets. Prints
also the translation error of the ego motion by registration against recorded poses.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

# Before torch is loaded; the node does the same.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
from drives import TrueSweep, real_sweeps, simulated_sweeps
from frame import Table, make_parser, publish
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.ego_motion.ego_motion import EgoMotion
from mnsf_ros.evaluation.metrics import by_motion
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_FIRST: Final = 4
_STEP: Final = 6
_NUM_THREADS: Final = 2
# Row to method, preset, and whether it gets whole sweeps or the points of the paper's protocol.
_ROWS: Final = {
    "online": ("online", "online", True),
    "neural": ("neural", "neural", True),
    "ego motion, estimated": ("ego-estimated", "online", True),
    "FNSF (paper)": ("fnsf", "paper", False),
    "MNSF (paper)": ("mnsf", "paper", False),
}
_PARTS: Final = ("dynamic", "static")
_DRIVES: Final = ("kitti_0005", "apollo_arz034", "ouster_os1_128", "nebula_vls128")

# Group of points to its mean error over examples, metres.
Errors = dict[str, float]


def main() -> None:
    """Measures, prints the tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="one street, a third of the sweeps")
    options = parser.parse_args()
    publish("accuracy", tables(quick=options.quick), options.document)


def tables(*, quick: bool) -> Iterator[Table]:
    """EPE and time of all groups of recordings, and errors of the ego motion."""
    streets = [simulated_sweeps(seed, 16) for seed in range(1 if quick else 3)]
    groups = {"KITTI 0005": [real_sweeps("kitti_0005")], "streets": streets}
    measured = {
        group: {row: _measured(row, recordings, quick=quick) for row in _ROWS}
        for group, recordings in groups.items()
        if any(recordings)
    }
    columns = [f"EPE {part} (m)" for part in _PARTS] + ["time (ms)"]
    header = [f"{group}: {column}" for group in measured for column in columns]
    rows = [[row, *(cell for of_row in measured.values() for cell in of_row[row])] for row in _ROWS]
    yield Table(f"Every {_STEP}th sweep", ["", *header], rows)
    drives = {name: _ego_errors_m(sweeps) for name in _DRIVES if (sweeps := real_sweeps(name))}
    rows = [[name, f"{np.mean(found):.4f}", f"{max(found):.3f}"] for name, found in drives.items()]
    header = ["translation of the ego motion a sweep", "mean error (m)", "largest (m)"]
    yield Table("Registration", header, rows, is_detail=True)


def _measured(row: str, recordings: Sequence[list[TrueSweep]], *, quick: bool) -> list[str]:
    """Mean errors in metres, and the mean time of an estimate in ms."""
    method, name, is_whole = _ROWS[row]
    settings = preset(name).changed({"compute.num_threads": _NUM_THREADS})
    found: list[Errors] = []
    times_ms = []
    for sweeps in recordings:
        changes = {} if is_whole else {"ground.remove": False}
        estimator = make_method(method, settings.changed(changes))
        last = len(sweeps) - 2
        scored = range(_FIRST, last + 1, _STEP * (3 if quick else 1))
        # `online` sees every sweep; the networks start from scratch with each triplet.
        for index in range(1, last + 1) if is_whole else scored:
            triple = sweeps[index - 1 : index + 2]
            estimate, errors = _estimated(estimator, triple, is_whole=is_whole)
            if index in scored:
                times_ms.append(estimate.time_ms)
                found.append(errors)
    means = [f"{np.nanmean([each[part] for each in found]):.3f}" for part in _PARTS]
    return [*means, f"{np.mean(times_ms):.0f}"]


def _estimated(
    estimator: SceneFlowEstimator, triple: Sequence[TrueSweep], *, is_whole: bool
) -> tuple[FlowEstimate, Errors]:
    """The estimate for three sweeps, and its errors over labelled points without ground."""
    crop = preset("online").crop
    kept = [crop_mask(item.sweep.xyz, crop) for item in triple]
    if not is_whole:
        kept = [mask & ~item.ground for mask, item in zip(kept, triple, strict=True)]
    parts = (
        item.sweep if is_whole else _part(item.sweep, mask)
        for item, mask in zip(triple, kept, strict=True)
    )
    truth = triple[1]
    next_from_current = np.linalg.inv(triple[2].pose) @ truth.pose
    estimate = estimator.estimate(SweepTriplet(*parts, next_from_current=next_from_current))
    scored = truth.scored & kept[1]
    flow = estimate.flow[scored if is_whole else scored[kept[1]]]
    errors = by_motion(flow, truth.flow[scored], truth.dynamic[scored])
    return estimate, {part: errors[part].epe_m for part in _PARTS}


def _part(sweep: Sweep, mask: NDArray[np.bool_]) -> Sweep:
    return Sweep(sweep.xyz[mask], sweep.stamp_ns, sweep.frame_id)


def _ego_errors_m(sweeps: Sequence[TrueSweep]) -> list[float]:
    ego_motion = EgoMotion(preset("online").ego_motion)
    found = [ego_motion.pose_of(item.sweep) for item in sweeps]
    # The motion within the first sweep is known only after the second one.
    found[0] = replace(found[0], motion=ego_motion.motion_in(sweeps[0].sweep))
    poses = [pose.world_from_stamp for pose in found]
    errors_m = []
    for index in range(len(sweeps) - 1):
        ours = np.linalg.inv(poses[index]) @ poses[index + 1]
        theirs = np.linalg.inv(sweeps[index].pose) @ sweeps[index + 1].pose
        errors_m.append(float(np.linalg.norm((np.linalg.inv(theirs) @ ours)[:3, 3])))
    return errors_m


if __name__ == "__main__":
    main()
