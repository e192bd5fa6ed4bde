# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf flow`: the flow of one sweep, from and to single files."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mnsf_ros.cli.arguments import Subparsers, add_subcommand, chosen_settings
from mnsf_ros.cli.console import Console
from mnsf_ros.errors import SweepFileError
from mnsf_ros.presets import settings_for
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

if TYPE_CHECKING:
    from mnsf_ros.core.flow_estimate import FlowEstimate
    from mnsf_ros.settings import Settings
    from mnsf_ros.sweeps_io.read_sweep import SweepInFile
    from mnsf_ros.sweeps_io.write_flow import FlowToWrite

_EPILOG = """\
Sweeps: .npz (FILE.npz:ARRAY for one of several arrays), .npy, .pcd, .feather (Argoverse 2),
.bin (KITTI: rows of x, y, z, intensity), .pcd.bin (nuScenes: and ring).
OUT: .npz, .npy (flow alone) or .ply (coloured), row i for row i of CURRENT, NaN
where that has no point. Each sweep is in its own sensor frame; point + flow is
the place in NEXT. Methods that know what moves add velocity over ground (m/s),
dynamic (0 or 1) and confidence (0 to 1).

Examples:
  mnsf flow PREVIOUS CURRENT NEXT -o flow.ply
  mnsf flow PREVIOUS CURRENT NEXT -o flow.npz --preset paper
"""


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(
        subparsers,
        "flow",
        "estimate where each point of a sweep in a file is in the next one",
        _run,
        usage="mnsf flow [[EARLIER ...] PREVIOUS] CURRENT NEXT -o OUT [options]",
        epilog=_EPILOG,
    )
    arguments.value("sweeps SWEEP", "files in the order of time", nargs="+")
    arguments.value("-o --out OUT", "file to write, see below", Path, required=True)
    arguments.method()
    arguments.settings(default="online")
    arguments.value(
        "--interval-s S",
        "time between the sweeps in seconds, unless each file has a stamp",
        default=USUAL_INTERVAL_S,
    )
    arguments.flag("--force", "replace OUT if it is there")


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.online.stream import Stream
    from mnsf_ros.scene_flow import StepReport
    from mnsf_ros.sweeps_io.read_sweep import read_sweep, triplet_of_files
    from mnsf_ros.sweeps_io.write_flow import check_target, write_flow

    settings = chosen_settings(options)
    if len(options.sweeps) < 2:
        raise SweepFileError(f"got {len(options.sweeps)} sweep, expected CURRENT and NEXT at least")
    check_target(options.out, overwrite=options.force)
    sweeps = [read_sweep(name) for name in options.sweeps]
    triplet = triplet_of_files(sweeps, options.interval_s)
    method = options.method or settings.method.name
    stream = Stream(settings, method)
    if stream.traits.needs_poses and triplet.next_from_current is None:
        raise SweepFileError(
            f"method {method!r} needs the poses of the sensor: give CURRENT and NEXT as .npz with "
            "a pose, or use ego-estimated, which estimates them"
        )
    with Console(stderr=True).status(f"estimating with {method}") as status:
        estimate = stream.flow_of(triplet, StepReport(status.update))
    flow = _in_rows_of_file(
        sweeps[-2], triplet.interval_s, estimate, method, settings_for(method, settings)
    )
    write_flow(options.out, flow, overwrite=options.force)
    Console().say(_summary(options.out, method, flow, estimate), soft_wrap=True)


def _in_rows_of_file(
    current: SweepInFile, interval_s: float, estimate: FlowEstimate, method: str, settings: Settings
) -> FlowToWrite:
    import numpy as np

    from mnsf_ros.core.flow_columns import FLOW_COLUMNS, flow_columns
    from mnsf_ros.sweeps_io.write_flow import FlowToWrite

    kept = np.zeros(len(current.xyz), dtype=bool)
    kept[current.measured] = estimate.kept
    known = [one for one in FLOW_COLUMNS if one.values(estimate, interval_s) is not None]
    columns = flow_columns(estimate, interval_s, current.measured, known)
    return FlowToWrite(current.xyz, kept, columns, method, settings.to_mapping())


def _summary(out: Path, method: str, flow: FlowToWrite, estimate: FlowEstimate) -> str:
    import numpy as np

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
