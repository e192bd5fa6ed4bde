# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The true flow of sweeps, by poses, tracked boxes or flow labels."""

import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mnsf_ros.arrays import AnyFloats, Bools, Floats, Floats32, Ints
from mnsf_ros.datasets.formats import TruthSettings
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow, rigid_flow
from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, FlowTruth
from mnsf_ros.settings import GroundSettings
from mnsf_ros.sweeps.ground_surface import ground_mask

_OFFICIAL_GROWTH_M = np.array([0.2, 0.2, 0.0])


def sweep_truth(
    sweep: LabelledSweep, following: LabelledSweep | None, settings: TruthSettings
) -> FlowTruth:
    """Returns the truth of every point until the following sweep; without one, no flow is valid."""
    ground, boxes = _ground_of(sweep), sweep.boxes or ()
    if settings.official:
        owner = official_box_of_points(sweep.xyz, boxes)
        if following is not None:
            seen = (box for box in following.boxes or () if not box.hidden)
            following = replace(following, boxes=tuple(seen))
    else:
        owner = box_of_points(sweep.xyz, boxes, settings.box_margin_m, ground)
    class_id = sweep.class_id
    if class_id is None:
        class_id = np.array([box.class_id for box in boxes] + [0], dtype=np.uint8)[owner]
    flow, valid, dynamic = _motion(sweep, following, owner)
    # A point in a box is labelled, wherever the box is.
    valid = valid & (_reach(sweep, settings) | (owner >= 0))
    if sweep.own_vehicle is not None:
        valid &= ~sweep.own_vehicle
    # Boxes of a track have the same number in every sweep.
    numbers = [_object_id(box.track_id) for box in boxes]
    object_id = None if sweep.boxes is None else np.array([*numbers, 0], np.uint32)[owner]
    return FlowTruth(sweep.stamp_ns, flow, valid, dynamic & valid, ground, class_id, object_id)


def _object_id(track_id: str | int | None) -> int:
    """A number above 0 for a track; 0 for none."""
    return 0 if track_id is None else max(1, zlib.crc32(str(track_id).encode()))


def box_of_points(xyz: Floats32, boxes: Sequence[Box], margin_m: float, ground: Bools) -> Ints:
    """Returns the index (N,) of the box of each point (N, 3), -1 for none.

    Labelled boxes are tight, so they grow by `margin_m` in length, width and height, half of it on
    either side, except for points of the ground (N,). A point in several boxes belongs to the one
    in which it is deepest. Hidden boxes own no points.
    """
    owner = np.full(len(xyz), -1, dtype=np.int64)
    overshoot = np.full(len(xyz), np.inf)
    for number, rows, local in _points_near(xyz, boxes, margin_m):
        outside = (np.abs(local) - boxes[number].size_m / 2).max(axis=1)
        allowed = np.where(ground[rows], 0.0, margin_m / 2)
        mine = (outside <= allowed) & (outside < overshoot[rows])
        owner[rows[mine]] = number
        overshoot[rows[mine]] = outside[mine]
    return owner


def official_box_of_points(xyz: Floats32, boxes: Sequence[Box]) -> Ints:
    """Returns (N,) the index of the last box with each point (N, 3), -1 for none.

    Boxes grow by 0.2 m in length and width, not in height; ground inside belongs to them, too.
    """
    owner = np.full(len(xyz), -1, dtype=np.int64)
    for number, rows, local in _points_near(xyz, boxes, _OFFICIAL_GROWTH_M[0]):
        limits = (boxes[number].size_m + _OFFICIAL_GROWTH_M) / 2
        owner[rows[(np.abs(local) <= limits).all(axis=1)]] = number
    return owner


def _points_near(
    xyz: Floats32, boxes: Sequence[Box], margin_m: float
) -> Iterator[tuple[int, Ints, AnyFloats]]:
    """Yields the index of each visible box, points around it, and these (M, 3) in its frame."""
    x, y = np.ascontiguousarray(xyz[:, 0]), np.ascontiguousarray(xyz[:, 1])
    for number, box in enumerate(boxes):
        if box.hidden:
            continue
        reach = float(np.linalg.norm(box.size_m + margin_m)) / 2
        near = (np.abs(x - box.pose[0, 3]) <= reach) & (np.abs(y - box.pose[1, 3]) <= reach)
        rows: Ints = np.flatnonzero(near)
        local: AnyFloats = apply(invert(box.pose), xyz[rows].astype(np.float64))
        yield number, rows, local


def _motion(
    sweep: LabelledSweep, following: LabelledSweep | None, owner: Ints
) -> tuple[Floats32, Bools, Bools]:
    """Returns (N, 3) flow, (N,) whether it is known, and (N,) whether the surface itself moves."""
    ego_motion = None if following is None else _ego_motion(sweep, following)
    if following is None or (sweep.flow is None and ego_motion is None):
        nowhere: Bools = np.zeros(len(sweep), dtype=bool)
        return np.zeros_like(sweep.xyz), nowhere, nowhere
    if sweep.flow is not None:
        flow, valid = sweep.flow, _finite_rows(np.hstack([sweep.xyz, sweep.flow]))
        if sweep.flow_valid is not None:
            valid &= sweep.flow_valid
    if ego_motion is None:
        ego_motion = fit_rigid_motion(sweep.xyz[valid], flow[valid])
    if sweep.flow is None:
        flow, valid = _flow_of_boxes(sweep, following, owner, ego_motion)
    if sweep.dynamic is not None:
        return flow, valid, sweep.dynamic
    interval_s = (following.stamp_ns - sweep.stamp_ns) * 1e-9
    with np.errstate(invalid="ignore", over="ignore"):
        residual = np.linalg.norm(residual_flow(sweep.xyz, flow, ego_motion), axis=1)
        return flow, valid, np.asarray(residual > DYNAMIC_SPEED_M_S * interval_s)


def _flow_of_boxes(
    sweep: LabelledSweep, following: LabelledSweep, owner: Ints, next_from_current: Floats
) -> tuple[Floats32, Bools]:
    """Returns the flow of points that move with their boxes, and whether it is known."""
    valid, flow = _finite_rows(sweep.xyz), rigid_flow(sweep.xyz, next_from_current)
    tracks, counterparts = _tracks(sweep.boxes or ()), _tracks(following.boxes or ())
    for number, box in enumerate(sweep.boxes or ()):
        rows = np.flatnonzero(owner == number)
        counterpart = counterparts.get(box.track_id) if box.track_id in tracks else None
        if counterpart is None:
            valid[rows] = False
        else:
            next_from_box = np.asarray(counterpart.pose @ invert(box.pose), dtype=np.float64)
            flow[rows] = rigid_flow(sweep.xyz[rows], next_from_box)
    return flow, valid


def _tracks(boxes: Sequence[Box]) -> Mapping[str | int | None, Box]:
    """Returns boxes by their track, without tracks that occur twice."""
    counts = Counter(box.track_id for box in boxes)
    return {
        box.track_id: box for box in boxes if box.track_id is not None and counts[box.track_id] == 1
    }


def _ego_motion(sweep: LabelledSweep, following: LabelledSweep) -> Floats | None:
    if sweep.pose is None or following.pose is None:
        return None
    return np.asarray(invert(following.pose) @ sweep.pose, dtype=np.float64)


def _reach(sweep: LabelledSweep, settings: TruthSettings) -> Bools:
    """Returns (N,) whether labels distinguish dynamic from static points there."""
    is_labelled = sweep.boxes is not None or sweep.flow is not None
    if settings.unlabelled_static or not is_labelled or sweep.labelled is None:
        return np.full(len(sweep), settings.unlabelled_static or is_labelled)
    return sweep.labelled


def _ground_of(sweep: LabelledSweep) -> Bools:
    if sweep.ground is not None:
        return sweep.ground
    ground = np.zeros(len(sweep), dtype=bool)
    finite = _finite_rows(sweep.xyz)
    ground[finite] = ground_mask(sweep.xyz[finite], GroundSettings())
    return ground


def _finite_rows(rows: Floats32) -> Bools:
    return np.asarray(np.isfinite(rows).all(axis=1), dtype=np.bool_)
