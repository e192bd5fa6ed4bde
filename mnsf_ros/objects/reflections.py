"""What goes along with the sensor: a window is seen only where it faces the sensor."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.objects.object_points import ObjectPoints

# A pane is no thicker than this, by noise and frame.
_MAX_THICKNESS_M: Final = 0.25
# It slides along itself: this share of its motion is along the pane.
_MIN_ALONG: Final = 0.9
# It goes as far as the sensor, up to this plus this share.
_SAME_MOTION_M: Final = 0.1
_SAME_MOTION_SHARE: Final = 0.2
# A sensor that hardly moves along the pane takes nothing along.
_MIN_SENSOR_M: Final = 0.05
# Glass returns light about its normal, that is, as far as this beside the foot of the sensor, as a
# share of the distance.
_BESIDE: Final = 0.27


def are_reflections(
    objects: ObjectPoints, motions: NDArray[np.float32], sensor: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Returns (K,) whether objects are upright sheets that go along with the sensor beside them.

    A vehicle that drives beside the sensor, just as fast, is thicker or seen at other angles, too.

    Args:
        objects: K objects.
        motions: (K, 3) metres, their motions to the next sweep.
        sensor: (3,) metres, that of the sensor.
    """
    xx, yy, xy, _ = objects.variances
    angles = np.arctan2(2 * xy, xx - yy) / 2
    cosines, sines = np.cos(angles), np.sin(angles)

    def along(vectors: NDArray[np.floating]) -> NDArray[np.float64]:
        parts: NDArray[np.float64] = np.abs(vectors[..., 0] * cosines + vectors[..., 1] * sines)
        return parts

    half, root = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    # The variance of points spread evenly is a twelfth of the squared width.
    thick, wide = (np.sqrt(12 * np.maximum(half + sign * root, 0.0)) for sign in (-1, 1))
    lengths = np.sqrt((motions**2).sum(axis=1))
    x, y = objects.centers[:, 0], objects.centers[:, 1]
    slides = (thick < _MAX_THICKNESS_M) & (along(motions) > _MIN_ALONG * lengths)
    goes_along = along(motions - sensor) < _SAME_MOTION_M + _SAME_MOTION_SHARE * lengths
    is_beside = along(objects.centers) < wide / 2 + _BESIDE * np.abs(y * cosines - x * sines)
    result: NDArray[np.bool_] = slides & goes_along & is_beside & (along(sensor) > _MIN_SENSOR_M)
    return result
