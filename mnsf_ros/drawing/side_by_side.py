# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Several motions of the same sweeps side by side, as an animation."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mnsf_ros.drawing.street_picture import street_picture

_WIDTH_PX, _HEIGHT_PX = 560, 299
_GAP_PX: Final = 4
_GAP_COLOR: Final = (90, 98, 110)


def frame(
    xyz: NDArray[np.float32], velocities: Sequence[NDArray[np.float32]], full_speed_m_s: float
) -> bytes:
    """Returns a PNG file with a picture for each of the velocities, see `street_picture`."""
    width = len(velocities) * (_WIDTH_PX + _GAP_PX) - _GAP_PX
    whole = Image.new("RGB", (width, _HEIGHT_PX), _GAP_COLOR)
    for place, velocity in enumerate(velocities):
        picture = street_picture(xyz, velocity, [], full_speed_m_s)
        picture = picture.resize((_WIDTH_PX, _HEIGHT_PX), Image.Resampling.BOX)
        whole.paste(picture, (place * (_WIDTH_PX + _GAP_PX), 0))
    content = io.BytesIO()
    whole.save(content, "PNG")
    return content.getvalue()


def animation(frames: Sequence[bytes], interval_s: float) -> bytes:
    """Returns a WebP file of PNG files that plays at an interval."""
    first, *others = (Image.open(io.BytesIO(one)) for one in frames)
    content = io.BytesIO()
    duration = max(1, round(1e3 * interval_s))
    first.save(
        content, "WEBP", save_all=True, append_images=others, duration=duration, loop=0, quality=60
    )
    return content.getvalue()
