# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""An animation of the flow of a recording, for a page or a talk."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.drawing.color_wheel import FULL_COLOR_M_S
from mnsf_ros.drawing.street_picture import ShownObject, street_picture
from mnsf_ros.errors import RecordingError
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.view.estimated_sweeps import EstimatedSweep

_WAY_SWEEPS: Final = 12
_QUALITY: Final = 45
# Of 0 to 6: 6 takes 12 times as long for 6 % less.
_EFFORT: Final = 4
_USUAL_INTERVAL_S: Final = 0.1


def save_animation(sweeps: Iterable[EstimatedSweep], path: Path) -> int:
    """Writes a WebP that plays at the pace of the sweeps; returns how many there were.

    Raises:
        RecordingError: There is no sweep with a flow.
        OSError: The file cannot be written.
    """
    frames, intervals_s = [], []
    ways: dict[int, deque[NDArray[np.float32]]] = defaultdict(lambda: deque(maxlen=_WAY_SWEEPS))
    for shown in sweeps:
        frames.append(_picture(shown, ways))
        intervals_s.append(shown.triplet.interval_s)
    if not frames:
        raise RecordingError(f"{path}: no sweep of the recording has a flow")
    interval_s = float(np.median(intervals_s)) or _USUAL_INTERVAL_S
    path.parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(
        path,
        format="WEBP",
        save_all=True,
        append_images=frames[1:],
        duration=max(1, round(1e3 * interval_s)),
        loop=0,
        quality=_QUALITY,
        method=_EFFORT,
    )
    return len(frames)


def _picture(shown: EstimatedSweep, ways: dict[int, deque[NDArray[np.float32]]]) -> Image.Image:
    sweep, known = shown.triplet.current, shown.estimate.over_ground
    if known is None:
        motion, objects = shown.estimate.flow, []
    else:
        motion, objects = known.motion, list(_objects(known, ways))
    velocity = motion / np.float32(shown.triplet.interval_s or _USUAL_INTERVAL_S)
    return street_picture(sweep.xyz, velocity, objects, FULL_COLOR_M_S)


def _objects(
    known: OverGround, ways: dict[int, deque[NDArray[np.float32]]]
) -> Iterator[ShownObject]:
    sensor_from_world = np.asarray(np.linalg.inv(known.world_from_sensor), np.float64)
    for item in known.objects:
        if item.num_points == 0:
            continue
        way = ways[item.track_id]
        seen = transformed(np.array(way, np.float32).reshape(-1, 3), sensor_from_world)
        way.append(transformed(item.center[None].astype(np.float32), known.world_from_sensor)[0])
        yield ShownObject(item.center, item.size, item.yaw, item.velocity, seen)
