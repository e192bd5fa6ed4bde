# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Points of movers, corrected for their motion during the sweep."""

from dataclasses import replace

import numpy as np

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import flow_cloud


def moving_cloud(
    triplet: SweepTriplet, estimate: FlowEstimate, known: OverGround, settings: Settings
) -> bytes:
    """Returns the `flow_cloud` of dynamic points, at the stamp with `output.deskew_movers`.

    Without times of points, or the interval to the next sweep, they are where they were measured.
    """
    sweep, interval_s, output, moved = triplet.current, triplet.interval_s, settings.output, None
    if output.deskew_movers and sweep.times_s is not None and interval_s > 0:
        deskew = settings.ego_motion.deskew
        moved, estimate = movers_at_stamp(sweep, estimate, known, interval_s, deskew=deskew)
    return flow_cloud(sweep, estimate, interval_s, output, known.dynamic, moved)


def movers_at_stamp(
    sweep: Sweep, estimate: FlowEstimate, known: OverGround, interval_s: float, *, deskew: bool
) -> tuple[Floats32, FlowEstimate]:
    """Moves dynamic points to their positions at the stamp of the sweep.

    Args:
        sweep: The sweep, with the times of its points.
        estimate: Its flow.
        known: The motion over ground in the estimate.
        interval_s: Seconds to the next sweep, above 0.
        deskew: Whether each point is in the frame of the sensor at its own time instead of at the
            stamp.

    Returns:
        (N, 3) metres, in the frame of the sensor at the stamp, static points unchanged; and the
        estimate with the flow from there.
    """
    rows = np.flatnonzero(known.dynamic)
    xyz, flow = sweep.xyz.copy(), estimate.flow.copy()
    times_s = np.zeros(len(rows), np.float32) if sweep.times_s is None else sweep.times_s[rows]
    places = xyz[rows]
    if deskew:
        step = np.asarray(np.linalg.inv(known.next_from_current), np.float64)
        places = SweepMotion.of_step(step, interval_s, 0.0).moved(places, times_s)
    places -= known.motion[rows] * (times_s / np.float32(interval_s))[:, None]
    flow[rows] += turned(places - xyz[rows], known.next_from_current[:3, :3] - np.eye(3))
    xyz[rows] = places
    return xyz, replace(estimate, flow=flow)
