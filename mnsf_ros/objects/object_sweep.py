"""A prepared sweep: its objects above the ground, and a grid of its points."""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.ego_motion.ego_motion import SensorPose
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.thinning import thinned
from mnsf_ros.objects.point_grid import PointGrid
from mnsf_ros.objects.range_view import RangeView
from mnsf_ros.objects.segmentation import Segmentation
from mnsf_ros.objects.sweep_clock import SweepClock
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import kept_mask
from mnsf_ros.sweeps.sweep import Sweep

_MIN_POINTS: Final = 10


class ObjectSweep:
    """Built once for each sweep, used as next, current, previous and one of the past.

    Attributes:
        sweep: The sweep as it came.
        pose: Where it was taken.
        xyz: (N, 3) float32, metres, its points in the sensor frame of one moment.
        kept: (N,) bool, the points inside the crop that are not ground.
        clock: When which direction was measured; None if not known.
        thinned: (T, 3) float32, metres, sensor frame: the kept points, one for each small cell.
        thinned_objects: (T,) int, their objects.
        num_objects: Number of objects; number 0 is none.
        grid: The thinned points in cells.
    """

    def __init__(self, sweep: Sweep, pose: SensorPose, settings: Settings) -> None:
        """Crops, removes ground, segments.

        Raises:
            SweepError: If too few points are left.
        """
        self.sweep = sweep
        self.pose = pose
        self.xyz = pose.in_one_moment(sweep)
        self.kept = kept_mask(self.xyz, settings)
        self.clock = None
        if pose.motion is not None and sweep.times_s is not None:
            self.clock = SweepClock.of(self.xyz, sweep.times_s)
        # What moves is elsewhere when it is seen again: objects are made of first views.
        self._in_objects = self.kept if self.clock is None else self.kept & ~self.clock.is_again
        points = np.compress(self._in_objects, self.xyz, axis=0)
        if len(points) < _MIN_POINTS:
            raise SweepError(
                f"sweep {sweep.stamp_ns}: {len(points)} of {len(sweep)} points are left after crop "
                f"and ground removal, expected at least {_MIN_POINTS}"
            )
        segmentation = Segmentation(points, settings.objects.cell_size_m)
        self._point_objects = segmentation.objects_of(points)
        self.num_objects = segmentation.num_objects
        self.thinned = _thinned(points, settings)
        self.thinned_objects = segmentation.objects_of(self.thinned)
        self.grid = PointGrid(self.thinned)

    @cached_property
    def view(self) -> RangeView:
        """The range image of the sweep."""
        return RangeView(self.xyz)

    def objects(self) -> NDArray[np.int64]:
        """(N,) the object of each point of the sweep.

        It is 0 for ground, for what was cropped, and for points that were seen a second time.
        """
        objects = np.zeros(len(self.sweep), dtype=np.int64)
        objects[self._in_objects] = self._point_objects
        return objects


def _thinned(points: NDArray[np.float32], settings: Settings) -> NDArray[np.float32]:
    stride = max(1, -(-len(points) // settings.objects.max_points))
    return thinned(points[::stride], settings.objects.thinning_m)
