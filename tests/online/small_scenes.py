# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of a few boxes in empty space, made ready without ground removal."""

from __future__ import annotations

import numpy as np

from mnsf_ros.ego_motion.ego_motion import EgoSource, SensorPose
from mnsf_ros.online.motions import JudgedMotions, TrackPrior
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.target import Target, Targets
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep

# The boxes have fewer points than real objects.
SETTINGS = Settings().changed(
    {"ground.remove": False, "objects.thinning_m": 0.02, "objects.cell_size_m": 0.25}
)


def surface(center, size=(2.0, 1.5, 1.5), num_points=300):
    """(N, 3) points of a box's sides, the same at every place."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (num_points, 3))
    rows, axes = np.arange(num_points), rng.integers(0, 3, num_points)
    points[rows, axes] = np.copysign(0.5, points[rows, axes])
    return (points * size + center).astype(np.float32)


def prepared(*parts, world_from_sensor=None, stamp_ns=0, settings=SETTINGS):
    """A sweep of these points, made ready."""
    pose = np.eye(4) if world_from_sensor is None else world_from_sensor
    xyz = np.concatenate([np.asarray(part, np.float32).reshape(-1, 3) for part in parts])
    sweep = Sweep(xyz, stamp_ns, "lidar")
    return ObjectSweep(sweep, SensorPose(pose, EgoSource.START), settings)


def objects_of(sweep, **changes):
    """The objects of a prepared sweep."""
    settings = SETTINGS.changed({f"objects.{name}": value for name, value in changes.items()})
    return ObjectPoints.of(sweep, settings.objects)


def target(of, current, intervals=1.0):
    """Another prepared sweep as a target for the current one."""
    return Target.of(of, current, intervals)


def rows(*values):
    """(K, 3) float32."""
    return np.array(values, np.float32).reshape(-1, 3)


def table_of(objects, prior=None, targets=None, **columns):
    """A table of objects, without tracks unless given, with other values in some columns."""
    prior = prior or TrackPrior.without_tracks(len(objects))
    table = ObjectTable.begun(objects, objects.numbers, prior, targets or Targets([None, None], []))
    return table.put(np.arange(len(objects)), **columns)


def moved_by(motions):
    """Motions (K, 3), metres, with residuals of nothing."""
    return JudgedMotions(motions, np.zeros((len(motions), 2)), np.zeros((len(motions), 0)))
