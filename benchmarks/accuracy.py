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
from frame import TARGET_HEADER, Table, Target, make_parser, publish
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
_ONLINE, _NEURAL, _EGO = "online", "neural", "ego motion, estimated"
_FNSF, _MNSF = "FNSF (paper)", "MNSF (paper)"
# Row to method, preset, and whether it gets whole sweeps or the points of the paper's protocol.
_ROWS: Final = {
    _ONLINE: ("online", "online", True),
    _NEURAL: ("neural", "neural", True),
    _EGO: ("ego-estimated", "online", True),
    _FNSF: ("fnsf", "paper", False),
    _MNSF: ("mnsf", "paper", False),
}
_PARTS: Final = ("all", "dynamic", "static")
_MAX_STATIC_M: Final = 0.02
_MAX_EGO_ERROR_M: Final = 0.02
_MIN_SPEED_UP: Final = 100
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
    """EPE of all groups of recordings, and the targets."""
    streets = [simulated_sweeps(seed, 16) for seed in range(1 if quick else 3)]
    groups = {"KITTI 0005": [real_sweeps("kitti_0005")], "streets": streets}
    measured = {
        group: {row: _measured(row, recordings, quick=quick) for row in _ROWS}
        for group, recordings in groups.items()
        if any(recordings)
    }
    header = [f"{group}: EPE {part} (m)" for group in measured for part in _PARTS]
    rows = [
        [
            row,
            *(f"{of_row[row][0][part]:.3f}" for of_row in measured.values() for part in _PARTS),
        ]
        for row in _ROWS
    ]
    yield Table(f"Every {_STEP}th sweep", ["", *header], rows)
    targets: list[Target] = []
    for group, of_row in measured.items():
        targets += _targets(group, {row: found for row, (found, _) in of_row.items()})
        name = f"{group}: times faster than {_MNSF}"
        speed_up = of_row[_MNSF][1] / of_row[_ONLINE][1]
        targets.append(Target(name, _MIN_SPEED_UP, speed_up, is_minimum=True))
    targets += _ego_targets()
    rows = [target.row() for target in targets]
    yield Table("Accuracy targets", TARGET_HEADER, rows, is_detail=True)


def _measured(
    row: str, recordings: Sequence[list[TrueSweep]], *, quick: bool
) -> tuple[Errors, float]:
    """Mean errors, and the mean time of an estimate in ms."""
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
    means = {part: float(np.nanmean([each[part] for each in found])) for part in _PARTS}
    return means, float(np.mean(times_ms))


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


def _targets(group: str, errors: dict[str, Errors]) -> Iterator[Target]:
    ours, others = errors[_ONLINE], [errors[row] for row in (_FNSF, _MNSF, _EGO)]
    best_m = min(other["all"] for other in others)
    yield Target(f"{group}: EPE (m), best of the others", best_m, ours["all"])
    half_m = min(errors[row]["dynamic"] for row in (_FNSF, _EGO)) / 2
    name = f"{group}: dynamic EPE (m), half of {_FNSF} and of ego motion"
    yield Target(name, half_m, ours["dynamic"])
    yield Target(f"{group}: static EPE (m)", _MAX_STATIC_M, ours["static"])


def _ego_targets() -> Iterator[Target]:
    for name in _DRIVES:
        if sweeps := real_sweeps(name):
            errors_m = _ego_errors_m(sweeps)
            mean_m = float(np.mean(errors_m))
            text = f"{mean_m:.4f}, {max(errors_m):.3f} at most"
            title = f"{name}: translation of the ego motion a sweep (m)"
            yield Target(title, _MAX_EGO_ERROR_M, mean_m, text=text)


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
