# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Visibility of objects in other sweeps: free space, occlusion, reflections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.motion_fusion import Targets
from mnsf_ros.objects.object_points import ObjectPoints


@dataclass(frozen=True, eq=False)
class Visibility:
    """Free and visible shares of K objects in other sweeps.

    A place that was seen through is evidence of motion. A place that was hidden is none: there a
    static object leaves a residual, too.

    Attributes:
        free: (K,) share of each object's points that are in free space of a sweep if the object is
            static, summed over the sweeps, less the same if it moves.
        visible_past: (K, S) share of its points that are not behind something in each of S older
            sweeps if it is static.
        reflection: (K,) how much it looks like what a window shows, see `reflections`.
    """

    free: NDArray[np.float64]
    visible_past: NDArray[np.float64]
    reflection: NDArray[np.int64]

    @classmethod
    def of(
        cls, objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
    ) -> Visibility:
        """Returns the visibility in the targets of K objects with motions (K, 3), metres."""
        free = np.zeros(len(objects))
        visible_past = np.zeros((len(objects), len(targets.past)))
        for number, target in enumerate((*targets.past, *targets.near)):
            is_free, is_hidden = target.seen(objects)
            free += is_free - target.seen(objects, motions)[0]
            if number < len(targets.past):
                visible_past[:, number] = 1 - is_hidden
        sensor = targets.near[0].to_current[:3, 3]
        return cls(free, visible_past, reflections(objects, motions, sensor))


# A pane is no thicker than this, by noise and frame, nor than this share of its width: pedestrians
# are thicker for their width.
_MAX_THICKNESS_M: Final = 0.25
_MAX_THICKNESS_SHARE: Final = 0.4
# It slides along itself: this share of its motion is along the pane.
_MIN_ALONG: Final = 0.9
# It goes as far as the sensor, up to this plus this share.
_SAME_MOTION_M: Final = 0.1
_SAME_MOTION_SHARE: Final = 0.2
# Of a row of panes the frames stay: what is seen goes along more slowly, by down to this share of
# the sensor's motion. It is longer than this.
_MIN_SHARE: Final = 0.4
_ROW_M: Final = 2.0
# A sensor that hardly moves along the pane takes nothing along.
_MIN_SENSOR_M: Final = 0.05
# Glass returns light about its normal, that is, as far as this beside the foot of the sensor, as a
# share of the distance.
_BESIDE: Final = 0.27
# All of a pane is this close to the foot, with some noise; of a vehicle it is not.
_ALL_BESIDE: Final = 0.35


def reflections(
    objects: ObjectPoints, motions: NDArray[np.float32], sensor: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Returns (K,) how much objects look like upright sheets that go along with the sensor.

    2: all of the sheet faces the sensor. 1: a part does, for example with some of the wall around
    it; so may a vehicle that drives beside the sensor just as fast. 0: it is none.

    Args:
        objects: K objects.
        motions: (K, 3) metres, their motions to the next sweep.
        sensor: (3,) metres, that of the sensor.
    """
    angles = objects.angles
    cosines, sines = np.cos(angles), np.sin(angles)

    def along(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
        parts: NDArray[np.float64] = np.abs(vectors[..., 0] * cosines + vectors[..., 1] * sines)
        return parts

    wide, thick, _ = objects.extents
    lengths = np.sqrt((motions**2).sum(axis=1))
    x, y = objects.centers[:, 0], objects.centers[:, 1]
    is_sheet = thick < np.minimum(_MAX_THICKNESS_M, _MAX_THICKNESS_SHARE * wide)
    slides = is_sheet & (along(motions) > _MIN_ALONG * lengths)
    goes_along = along(motions - sensor) < _SAME_MOTION_M + _SAME_MOTION_SHARE * lengths
    shares = (motions @ sensor) / np.maximum((sensor**2).sum(), _MIN_SENSOR_M**2)
    goes_along |= (shares > _MIN_SHARE) & (shares < 1) & (wide > _ROW_M)
    aside = np.abs(y * cosines - x * sines)
    goes_along &= slides & (along(sensor) > _MIN_SENSOR_M)
    from_foot = along(objects.centers)
    a_part = goes_along & (from_foot - wide / 2 < _BESIDE * aside)
    counts: NDArray[np.int64] = a_part + (
        a_part & (from_foot + wide / 2 < _ALL_BESIDE * aside)
    ).astype(np.int64)
    return counts
