"""Which points belong together: connected cells, seen from above."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

# A sweep whose points reach farther than this many cells is segmented coarser.
_MAX_CELLS_PER_AXIS: Final = 2048
_TOUCHING: Final = np.ones((3, 3), dtype=bool)


class Segmentation:
    """The objects of one sweep, numbered from 1; 0 means none.

    Attributes:
        num_objects: How many there are, number 0 included.
    """

    def __init__(self, points: NDArray[np.float32], cell_size_m: float) -> None:
        """Segments points that stand on the ground, the ground itself left out.

        Args:
            points: (N, 3) metres, N > 0.
            cell_size_m: Points in touching cells of this size are one object.
        """
        # By column: numpy takes ten times as long over the short axis of an array.
        self._low = [points[:, axis].min() for axis in (0, 1)]
        extent = max(float(points[:, axis].max() - self._low[axis]) for axis in (0, 1))
        self._cell_size_m = np.float32(max(cell_size_m, extent / _MAX_CELLS_PER_AXIS))
        cells = self._cells(points)
        occupied = np.zeros((cells[0].max() + 1, cells[1].max() + 1), dtype=bool)
        occupied[cells] = True
        self._labels, num_labels = ndimage.label(occupied, _TOUCHING)
        self.num_objects = int(num_labels) + 1

    def objects_of(self, points: NDArray[np.float32]) -> NDArray[np.int64]:
        """Returns (N,) the object of each of the points (N, 3)."""
        rows, columns = self._cells(points)
        height, width = self._labels.shape
        cells = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
        labels: NDArray[np.int64] = self._labels[cells].astype(np.int64)
        return labels

    def _cells(self, points: NDArray[np.float32]) -> tuple[NDArray[np.int32], ...]:
        """Row and column of the points' cells, (N,) each."""
        return tuple(
            ((points[:, axis] - low) / self._cell_size_m).astype(np.int32)
            for axis, low in enumerate(self._low)
        )
