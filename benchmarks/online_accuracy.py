# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the online preset beside FNSF, MNSF and ego motion alone, on the same sweeps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from online_recordings import TrueSweep, real_sweeps, simulated_sweeps

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.ego_motion.ego_motion import EgoMotion
from mnsf_ros.evaluation.metrics import FlowErrors, by_motion, mean_of
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_FIRST: Final = 4
_STEP: Final = 6
_NUM_THREADS: Final = 2
_ONLINE: Final = "online preset"
# Row to method, preset, and whether it is given whole sweeps or the points of the paper's protocol.
_ROWS: Final = {
    _ONLINE: ("online", "online", True),
    "ego motion, estimated": ("ego-estimated", "online", True),
    "ego motion, the truth's own": ("ego", "online", True),
    "FNSF (paper)": ("fnsf", "paper", False),
    "MNSF (paper)": ("mnsf", "paper", False),
}
_PARTS: Final = ("all", "dynamic", "static")
_MAX_STATIC_M: Final = 0.02
_MAX_EGO_ERROR_M: Final = 0.02
_MIN_SPEED_UP: Final = 100

Errors = dict[str, FlowErrors]


def accuracy_tables(*, quick: bool) -> Iterator[TextTable]:
    """Tables of errors, of targets and of the ego motion's own error."""
    groups = {"KITTI 0005": [real_sweeps("kitti_0005")], "simulated streets": _streets(quick)}
    errors: dict[str, dict[str, Errors]] = {}
    times_ms: dict[str, list[float]] = {}
    for group, recordings in groups.items():
        if any(recordings):
            errors[group] = {
                row: _mean(_run(row, recordings, times_ms.setdefault(row, []), quick))
                for row in _ROWS
            }
            yield _errors_table(group, errors[group])
    yield _targets_table(errors, {row: float(np.mean(times)) for row, times in times_ms.items()})
    yield _ego_table()


def _streets(quick: bool) -> list[list[TrueSweep]]:
    return [simulated_sweeps(seed, 16) for seed in range(1 if quick else 3)]


def _run(
    row: str, recordings: Sequence[list[TrueSweep]], times_ms: list[float], quick: bool
) -> Iterator[Errors]:
    method, name, is_whole = _ROWS[row]
    for sweeps in recordings:
        settings = preset(name).changed({"compute.num_threads": _NUM_THREADS})
        if not is_whole:
            settings = settings.changed({"ground.remove": False})
        estimator = make_method(method, settings)
        last = len(sweeps) - 2
        scored = range(_FIRST, last + 1, _STEP * (3 if quick else 1))
        # The online preset knows what came before; the others begin anew with each triplet.
        for index in range(1, last + 1) if is_whole else scored:
            triple = sweeps[index - 1 : index + 2]
            estimate, errors = _estimated(estimator, triple, is_whole=is_whole)
            if index in scored:
                times_ms.append(estimate.time_ms)
                yield errors


def _estimated(
    estimator: SceneFlowEstimator, triple: Sequence[TrueSweep], *, is_whole: bool
) -> tuple[FlowEstimate, Errors]:
    """The estimate for three sweeps, and its errors where there are labels and no ground."""
    crop = preset("online").crop
    kept = [crop_mask(item.sweep.xyz, crop) for item in triple]
    if not is_whole:
        kept = [mask & ~item.ground for mask, item in zip(kept, triple, strict=True)]
    previous, current, following = (
        item.sweep if is_whole else _part(item.sweep, mask)
        for item, mask in zip(triple, kept, strict=True)
    )
    truth = triple[1]
    next_from_current = np.linalg.inv(triple[2].pose) @ truth.pose
    estimate = estimator.estimate(
        SweepTriplet(previous, current, following, next_from_current=next_from_current)
    )
    rows = slice(None) if is_whole else kept[1]
    valid = (truth.scored & kept[1])[rows]
    return estimate, by_motion(estimate.flow, truth.flow[rows], truth.dynamic[rows], valid)


def _part(sweep: Sweep, mask: np.ndarray) -> Sweep:
    return Sweep(sweep.xyz[mask], sweep.stamp_ns, sweep.frame_id)


def _mean(examples: Iterator[Errors]) -> Errors:
    rows = list(examples)
    return {part: mean_of(row[part] for row in rows) for part in _PARTS}


def _errors_table(group: str, errors: dict[str, Errors]) -> TextTable:
    rows = [
        [
            row,
            f"{means['all'].epe_m:.3f}",
            f"{means['all'].acc5:.1%}",
            f"{means['all'].acc10:.1%}",
            f"{means['all'].outliers:.1%}",
            f"{means['all'].angle_error_rad:.3f}",
            f"{means['dynamic'].epe_m:.3f}",
            f"{means['static'].epe_m:.3f}",
        ]
        for row, means in errors.items()
    ]
    header = ["", "EPE (m)", "Acc5", "Acc10", "Outliers", "angle (rad)", "EPE dyn", "EPE static"]
    return TextTable(header, rows, f"{group}: errors, every {_STEP}th sweep after the first three")


def _targets_table(errors: dict[str, dict[str, Errors]], times_ms: dict[str, float]) -> TextTable:
    rows = [row for group, means in errors.items() for row in _targets(group, means)]
    ratio = times_ms["MNSF (paper)"] / times_ms[_ONLINE]
    verdict = _verdict(ratio >= _MIN_SPEED_UP)
    figure = f"{ratio:.0f} ({times_ms[_ONLINE]:.0f} ms, {times_ms['MNSF (paper)']:.0f} ms)"
    rows.append([f"faster than MNSF (paper), {_NUM_THREADS} threads", "100", figure, verdict])
    return TextTable(["target", "at least / at most", "measured", ""], rows, "Accuracy targets")


def _targets(group: str, errors: dict[str, Errors]) -> Iterator[list[str]]:
    others = ("FNSF (paper)", "MNSF (paper)", "ego motion, estimated")
    metrics: dict[str, tuple[Callable[[FlowErrors], float], int]] = {
        "EPE (m)": (lambda each: each.epe_m, -1),
        "Acc5": (lambda each: each.acc5, 1),
        "Acc10": (lambda each: each.acc10, 1),
        "Outliers": (lambda each: each.outliers, -1),
        "angle (rad)": (lambda each: each.angle_error_rad, -1),
    }
    ours = errors[_ONLINE]
    for name, (value_of, sign) in metrics.items():
        best = max(sign * value_of(errors[other]["all"]) for other in others)
        value = sign * value_of(ours["all"])
        text = f"{abs(value):.3f}"
        yield [f"{group}: {name} better than all", f"{abs(best):.3f}", text, _verdict(value > best)]
    halves = [errors[other]["dynamic"].epe_m / 2 for other in (others[0], others[2])]
    dynamic, static = ours["dynamic"].epe_m, ours["static"].epe_m
    limit = min(halves)
    yield [
        f"{group}: dynamic EPE half of FNSF and ego motion",
        f"{limit:.3f}",
        f"{dynamic:.3f}",
        _verdict(dynamic <= limit),
    ]
    yield [f"{group}: static EPE", "0.020", f"{static:.3f}", _verdict(static <= _MAX_STATIC_M)]


def _ego_table() -> TextTable:
    rows = []
    for name in ("kitti_0005", "apollo_arz034", "ouster_os1_128", "nebula_vls128"):
        sweeps = real_sweeps(name)
        if sweeps:
            errors_m = _ego_errors_m(sweeps)
            mean_m = float(np.mean(errors_m))
            verdict = _verdict(mean_m <= _MAX_EGO_ERROR_M)
            rows.append([name, "0.020", f"{mean_m:.3f}", f"{max(errors_m):.3f}", verdict])
    title = "Ego motion by registration: translation error a sweep (m) against recorded poses"
    return TextTable(["recording", "target (mean)", "mean", "max", ""], rows, title)


def _ego_errors_m(sweeps: Sequence[TrueSweep]) -> list[float]:
    ego_motion = EgoMotion(preset("online").ego_motion)
    found = [ego_motion.pose_of(item.sweep) for item in sweeps]
    # How the sensor moved in the first sweep is known only now.
    found[0] = replace(found[0], motion=ego_motion.motion_in(sweeps[0].sweep))
    poses = [pose.world_from_stamp for pose in found]
    errors_m = []
    for index in range(len(sweeps) - 1):
        ours = np.linalg.inv(poses[index]) @ poses[index + 1]
        theirs = np.linalg.inv(sweeps[index].pose) @ sweeps[index + 1].pose
        errors_m.append(float(np.linalg.norm((np.linalg.inv(theirs) @ ours)[:3, 3])))
    return errors_m


def _verdict(holds: bool) -> str:
    return "met" if holds else "MISSED"
