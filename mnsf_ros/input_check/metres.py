# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: coordinates are metres from the lidar."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample

_ASSUMPTION: Final = "coordinates are metres from the lidar"
# Lidars of vehicles and robots see up to 300 m, and most points much nearer.
_FARTHEST_M: Final = 300.0
# Half of the points in millimetres are farther, of a camera in a room, too; in centimetres nearer.
_MILLIMETRES: Final = 2000.0
# The middle of a cloud is so many times as far as its points are from there: they are elsewhere.
_FAR: Final = 10.0
_NUM_CLOUDS: Final = 100


class Metres(Assumption):
    """Looks at the middle of the cloud and at the range of half of the points."""

    def __init__(self) -> None:
        # From origin to middle, from there to half of the points, from the origin to these.
        self._clouds: deque[Floats] = deque(maxlen=_NUM_CLOUDS)

    def add(self, sample: SweepSample) -> None:
        """Takes the next cloud."""
        if len(sample.sweep):
            xyz = sample.sweep.some_xyz.astype(np.float64)
            middle = np.median(xyz, axis=0)
            ways = middle[None], xyz - middle, xyz
            self._clouds.append(np.array([np.median(np.linalg.norm(way, axis=1)) for way in ways]))

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if not self._clouds:
            return
        middle_m, size_m, range_m = np.median(self._clouds, axis=0)
        if range_m <= _FARTHEST_M:
            return
        if middle_m > _FAR * size_m:
            found = (
                f"the origin of the frame is {middle_m:,.0f} m from the points, which are "
                f"{size_m:.2g} m from their middle"
            )
            remedy = "Publish clouds in the frame of the lidar, not in that of a map or in UTM"
        else:
            unit, factor = ("milli", 1000) if range_m > _MILLIMETRES else ("centi", 100)
            found = f"half of the points are farther than {range_m:,.0f} m: the unit is no metre"
            remedy = f"Divide the coordinates by {factor}, if they are {unit}metres"
        yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)
