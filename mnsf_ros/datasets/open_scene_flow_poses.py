"""Where the points of OpenSceneFlow's files were measured, which its poses do not always tell."""

from __future__ import annotations

from typing import Final

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray, invert

# A lidar 1 m before the axis about which a vehicle turns goes so far astray at 1° per second.
_SAME_PLACE_M: Final = 2e-3
_SAME_TURN: Final = 1e-3


class LidarTrack:
    """Poses of the frame of the points, chained from sweep to sweep.

    The flow of what stands still tells how that frame moved. The poses of the files may be those
    of the vehicle instead, which moves in another way wherever it turns; they are followed only
    across sweeps without flow, and only if they agreed with all flow before.
    """

    def __init__(self) -> None:
        """Starts at the first sweep, whose frame is the world's."""
        self._pose: FloatArray | None = np.eye(4)
        self._last: tuple[FloatArray, FloatArray | None] | None = None
        self._agreed: list[bool] = []

    def advance(
        self, world_from_vehicle: FloatArray, next_from_current: FloatArray | None
    ) -> FloatArray | None:
        """Goes on to the next sweep, which may be the first one.

        Args:
            world_from_vehicle: (4, 4) the pose that the file has.
            next_from_current: (4, 4) motion from this sweep to the one after it, as the flow of
                what stands still has it; None if there is no such flow.

        Returns:
            (4, 4) `world_from_sweep`, None from where on it is not known any more.
        """
        if self._last is not None and self._pose is not None:
            motion = self._motion(invert(world_from_vehicle) @ self._last[0], self._last[1])
            self._pose = None if motion is None else self._pose @ invert(motion)
        self._last = (world_from_vehicle, next_from_current)
        return self._pose

    def _motion(self, by_poses: FloatArray, by_flow: FloatArray | None) -> FloatArray | None:
        if by_flow is not None:
            self._agreed.append(_is_same(by_poses, by_flow))
            return by_flow
        return by_poses if self._agreed and all(self._agreed) else None


def _is_same(one: FloatArray, other: FloatArray) -> bool:
    apart = np.abs(one - other)
    return bool(apart[:3, :3].max() < _SAME_TURN and apart[:3, 3].max() < _SAME_PLACE_M)
