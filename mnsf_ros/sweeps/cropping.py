"""Range and height crop: which points of a sweep the fields are fitted to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.settings import CropSettings


def crop_mask(xyz: NDArray[np.float32], settings: CropSettings) -> NDArray[np.bool_]:
    """Says which points are inside the crop.

    Args:
        xyz: (N, 3) metres, sensor frame.
        settings: Ranges (horizontal) and heights, metres.

    Returns:
        (N,) bool, the kept mask.
    """
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
