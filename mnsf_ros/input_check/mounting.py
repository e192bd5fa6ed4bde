# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: z is up, and the origin of the frame is the lidar."""

from collections import deque
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import Step, SweepSample
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting_estimate import is_levelled

_UP: Final = "z is up"
_LENS: Final = "the origin of the frame is the lidar"
# One look in so many sweeps: the mounting does not change.
_EVERY: Final = 20
_NUM_PLANES: Final = 100
_NUM_POINTS: Final = 1000
_CELL_M: Final = 0.5
_MIN_CELLS: Final = 50
_MIN_SHARE: Final = 0.1
_TOLERANCE_M: Final = 0.15
# Ground is near; farther out it is hardly seen, or at another height.
_REACH_M: Final = 25.0
_MAX_HEIGHT_M: Final = 6.0
# Share of the points that may be below ground: mirrored by wet roads, or of a slope.
_MAX_BELOW: Final = 0.05
# The steepest roads rise by 20 degrees; sensors tilted by 30 degrees still work.
_MAX_TILT_DEG: Final = 25.0
# Deviation of a beam from its cone. With the lidar at the origin: .0 to .1.
_MAX_BLUR_DEG: Final = 1.0
_MIN_AROUND: Final = 0.8


class Mounting:
    """Finds the ground as the plane with most points that has nothing below it."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._planes: deque[NDArray[np.float64]] = deque(maxlen=30)
        self._blurs_deg: deque[float] = deque(maxlen=30)
        self._num, self._num_beams = 0, 0

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        self._num += 1
        if self._num % _EVERY != 1:
            return
        plane = _ground(sample.xyz[sample.ranges < _REACH_M])
        if plane is not None:
            self._planes.append(plane)
        if (rings := sample.rings) is None or len(rings) == 0:
            return
        if not self._num_beams:
            self._num_beams = len(np.unique(rings))
        # Lidars that do not turn have beams that are no cones.
        if np.mean(sample.sectors) > _MIN_AROUND:
            directions = sample.xyz / sample.ranges[:, None]
            self._blurs_deg.append(_blur_deg(rings[sample.rows], directions))

    def move(self, step: Step) -> None:
        """The mounting is seen without motion."""

    @property
    def ground(self) -> NDArray[np.float64] | None:
        """(4,) plane n, h with n x + h the height of x above ground, median; None if unknown."""
        return np.median(self._planes, axis=0) if self._planes else None

    def facts(self) -> dict[str, str]:
        """Beams, height and tilt, in words."""
        beams = {"beams": f"{self._num_beams}"} if self._num_beams else {}
        if (ground := self.ground) is None:
            return beams | {"mounting": "unknown: no ground is seen"}
        side = "above" if ground[3] > 0 else "below"
        text = f"origin {abs(ground[3]):.2f} m {side} the ground"
        return beams | {"mounting": f"{text}, z {_tilt_deg(ground):.0f} degrees off its normal"}

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        ground = self.ground
        if ground is not None and (tilt_deg := _tilt_deg(ground)) > _MAX_TILT_DEG:
            axis = int(np.argmax(np.abs(ground[:3])))
            up = f"{'-' if ground[axis] < 0 else ''}{'xyz'[axis]}"
            found = (
                f"z is {tilt_deg:.0f} degrees off the normal of the ground, up is nearest to {up}"
            )
            remedy = "Set lidar_1.roll_deg and lidar_1.pitch_deg"
            severity = Severity.ERROR
            if is_levelled(tilt_deg, self._settings):
                severity, found = Severity.INFO, f"{found}; methods get the clouds upright"
            yield Finding(_UP, severity, found, remedy)
        remedy = (
            "Publish clouds in the frame of the lidar, or set lidars.frame to this frame, "
            "lidars.poses to parameters, and lidar_1.x_m to lidar_1.z_m to the place of the lidar"
        )
        is_given = self._settings.lidars.poses == "parameters"
        severity = Severity.INFO if is_given else Severity.WARNING
        if self._blurs_deg and (blur_deg := np.median(self._blurs_deg)) > _MAX_BLUR_DEG:
            found = f"beams are {blur_deg:.1f} degrees off cones around the origin of the frame, "
            yield Finding(_LENS, severity, f"{found}which is not the lidar", remedy)
        elif ground is not None and ground[3] < 0:
            found = f"the origin of the frame is {-ground[3]:.2f} m below ground"
            yield Finding(_LENS, severity, found, remedy)


def _tilt_deg(ground: NDArray[np.float64]) -> float:
    """Angle between z and the normal of a plane (4,)."""
    return float(np.degrees(np.arctan2(np.hypot(*ground[:2]), ground[2])))


def _ground(xyz: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(4,) plane of the ground of points (N, 3), its normal towards the other points.

    A plane with z up is preferred, unless another one has twice as many points.
    """
    # Areas, not densities: the robot's roof has many points.
    cells = np.unique(np.floor(xyz / _CELL_M).astype(np.int64), axis=0, return_index=True)[1]
    if len(cells) < _MIN_CELLS:
        return None
    rng = np.random.default_rng(len(cells))
    points = xyz[rng.permutation(cells)[:_NUM_POINTS]]
    first, second, third = points[rng.integers(0, len(points), (3, _NUM_PLANES))]
    normals = np.cross(second - first, third - first)
    lengths = np.linalg.norm(normals, axis=1)
    is_plane = lengths > 1.0
    normals, first = normals[is_plane] / lengths[is_plane, None], first[is_plane]
    heights = points @ normals.T - np.sum(first * normals, axis=1)
    # Up is where most of what is not on the plane is.
    above, below = (np.mean(side * heights > 2 * _TOLERANCE_M, axis=0) for side in (1, -1))
    normals *= np.where(below > above, -1.0, 1.0)[:, None]
    own_m = -np.sum(first * normals, axis=1)
    is_on = np.abs(heights) < _TOLERANCE_M
    is_lowest = np.minimum(above, below) < _MAX_BELOW
    counts = is_on.sum(axis=0) * (is_lowest & (np.abs(own_m) < _MAX_HEIGHT_M))
    counts[normals[:, 2] > np.cos(np.radians(_MAX_TILT_DEG))] *= 2
    best = np.argmax(counts)
    if counts[best] < _MIN_SHARE * len(points):
        return None
    own = points[is_on[:, best]]
    middle = own.mean(axis=0)
    normal = np.linalg.svd(own - middle, full_matrices=False)[2][2]
    normal *= np.sign(normal @ normals[best])
    return np.append(normal, -normal @ middle)


def _blur_deg(rings: NDArray[np.integer[Any]], directions: NDArray[np.float64]) -> float:
    """Mean deviation of directions (K, 3) from the cones of their beams, degrees.

    The common axis of the cones is the direction in which the beams vary least.
    """
    _, own = np.unique(rings, return_inverse=True)
    counts = np.bincount(own)
    means = np.stack([np.bincount(own, directions[:, axis]) / counts for axis in range(3)], axis=1)
    off = directions - means[own]
    least = np.linalg.eigvalsh(off.T @ off / len(off))[0]
    return float(np.degrees(np.sqrt(max(least, 0.0))))
