"""The points of a sweep that fields are fitted to: inside the crop, and not ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.settings import CropSettings, Settings
from mnsf_ros.sweeps.ground import ground_mask


def kept_mask(xyz: NDArray[np.float32], settings: Settings) -> NDArray[np.bool_]:
    """Says which of the points (N, 3), sensor frame, are kept."""
    kept = crop_mask(xyz, settings.crop)
    if settings.ground.remove:
        # np.compress is several times faster than xyz[kept].
        kept[kept] = ~ground_mask(np.compress(kept, xyz, axis=0), settings.ground)
    return kept


def crop_mask(xyz: NDArray[np.float32], settings: CropSettings) -> NDArray[np.bool_]:
    """Says which of the points (N, 3), sensor frame, are within the ranges and heights."""
    # float64: the square of a float32 coordinate of 1e20 is no float32.
    x, y = xyz[:, 0].astype(np.float64), xyz[:, 1].astype(np.float64)
    height = xyz[:, 2]
    squared_range = x * x + y * y
    kept: NDArray[np.bool_] = (
        (squared_range >= settings.min_range_m**2)
        & (squared_range <= settings.max_range_m**2)
        & (height >= settings.min_height_m)
        & (height <= settings.max_height_m)
    )
    return kept
