# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf flow`: the flow of one sweep, from and to single files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.cli.arguments import Arguments, chosen_settings
from mnsf_ros.cli.console import Console
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import SweepFileError
from mnsf_ros.online.stream import Stream
from mnsf_ros.presets import settings_for
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep, SweepTriplet
from mnsf_ros.sweeps_io.flow_columns import FLOW_COLUMNS, flow_columns
from mnsf_ros.sweeps_io.sweep_files import FlowToWrite, check_target, read_points, write_flow

_MIN_INTERVAL_S: Final = 0.001
_MAX_INTERVAL_S: Final = 60.0
_EPILOG = """\
Sweeps: .npz (array xyz; FILE.npz:ARRAY for another one), .npy, .pcd,
.bin (KITTI: rows of x, y, z, intensity) or .pcd.bin (nuScenes: and ring).
OUT: .npz or .ply (coloured), row i for row i of CURRENT, NaN
where that has no point. Each sweep is in its own sensor frame; point + flow is
the place in NEXT. Methods that know what moves add velocity over ground (m/s),
dynamic (0 or 1) and confidence (0 to 1).

Examples:
  mnsf flow PREVIOUS CURRENT NEXT -o flow.ply
  mnsf flow PREVIOUS CURRENT NEXT -o flow.npz --preset paper
"""


def add_flow(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.value(
        "sweeps SWEEP", "[[EARLIER ...] PREVIOUS] CURRENT NEXT, in the order of time", nargs="+"
    )
    arguments.value("-o --out OUT", "file to write, see below", Path, required=True)
    arguments.method()
    arguments.settings(default="online")
    arguments.value(
        "--interval-s S",
        "time between the sweeps in seconds",
        default=USUAL_INTERVAL_S,
    )
    arguments.flag("--force", "replace OUT if it is there")
    return _EPILOG


def run_flow(options: argparse.Namespace) -> None:
    """Estimates the flow, and writes it."""
    settings = chosen_settings(options)
    if len(options.sweeps) < 2:
        raise SweepFileError(f"got {len(options.sweeps)} sweep, expected CURRENT and NEXT at least")
    check_target(options.out, overwrite=options.force)
    clouds = {name: read_points(name) for name in options.sweeps}
    triplet = _triplet([clouds[name] for name in options.sweeps], options.interval_s)
    method = options.method or settings.method.name
    with Console(stderr=True).status(f"estimating with {method}"):
        estimate = Stream(settings, method).flow_of(triplet)
    flow = _in_rows_of_file(
        clouds[options.sweeps[-2]],
        triplet.interval_s,
        estimate,
        method,
        settings_for(method, settings),
    )
    write_flow(options.out, flow, overwrite=options.force)
    Console().say(_summary(options.out, method, flow, estimate), soft_wrap=True)


def _triplet(clouds: Sequence[NDArray[np.float32]], interval_s: float) -> SweepTriplet:
    """The finite points of clouds (N, 3) in the order of time, CURRENT and NEXT last."""
    if not _MIN_INTERVAL_S <= interval_s <= _MAX_INTERVAL_S:
        raise SweepFileError(
            f"interval between sweeps: got {interval_s:g} s, expected {_MIN_INTERVAL_S:g} to "
            f"{_MAX_INTERVAL_S:g} s"
        )
    sweeps = []
    for number, xyz in enumerate(clouds, start=1):
        points = xyz[_measured(xyz)]
        if len(points) == 0:
            raise SweepFileError(f"sweep {number} of {len(clouds)} has no finite point")
        sweeps.append(Sweep(points, number * round(interval_s * NANOSECONDS)))
    following, current, *before = reversed(sweeps)
    previous = before[0] if before else None
    return SweepTriplet(previous, current, following, earlier=tuple(before[1:]))


def _measured(xyz: NDArray[np.float32]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(xyz).all(axis=1))


def _in_rows_of_file(
    xyz: NDArray[np.float32],
    interval_s: float,
    estimate: FlowEstimate,
    method: str,
    settings: Settings,
) -> FlowToWrite:
    measured = _measured(xyz)
    kept = np.zeros(len(xyz), dtype=bool)
    kept[measured] = estimate.kept
    known = [one for one in FLOW_COLUMNS if one.values(estimate, interval_s) is not None]
    columns = flow_columns(estimate, interval_s, measured, known)
    return FlowToWrite(xyz, kept, columns, method, settings.to_mapping())


def _summary(out: Path, method: str, flow: FlowToWrite, estimate: FlowEstimate) -> str:
    lengths = np.linalg.norm(estimate.flow.astype(np.float64), axis=1)
    missing = len(flow.xyz) - len(lengths)
    stages = ", ".join(
        f"{stage} {fit.stop_reason.value} after {fit.iterations} steps"
        for stage, fit in estimate.fits.items()
    )
    known = estimate.over_ground
    dynamic = f", {int(known.dynamic.sum())} dynamic" if known is not None else ""
    ego_motion = f"; ego motion: {known.source}" if known is not None else ""
    return (
        f"{out}: {len(lengths)} points{f' and {missing} rows without' if missing else ''}, "
        f"{int(flow.kept.sum())} kept{dynamic}; {method}: flow {np.median(lengths):.3f} m "
        f"(median), {lengths.max():.3f} m (largest){ego_motion}; {estimate.time_ms / 1e3:.1f} s"
        f"{f' ({stages})' if stages else ''}"
    )
