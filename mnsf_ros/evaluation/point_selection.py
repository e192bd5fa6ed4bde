"""Which points of a sweep the methods get, and which of them are scored. The same for all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.settings import CropSettings, GroundSettings, Settings
from mnsf_ros.sweeps.cropping import crop_mask
from mnsf_ros.sweeps.ground import ground_mask

_SETTINGS: Final = Settings()


@dataclass(frozen=True)
class PointSelection:
    """The protocol.

    Attributes:
        crop: Points outside are neither given nor scored.
        ground: Neither are ground points, if `remove` is set.
        use_true_ground: Take the truth's own ground flag where there is truth; else ground is
            found as the node finds it.
        num_points: So many random points of what is left; None for all.
        seed: Of the random choice, together with the stamp of the sweep.
        gives_all: Give the methods all points, as the node does, so that they crop and remove
            ground themselves. What is scored stays the same.
    """

    crop: CropSettings = _SETTINGS.crop
    ground: GroundSettings = _SETTINGS.ground
    use_true_ground: bool = True
    num_points: int | None = None
    seed: int = 0
    gives_all: bool = False

    def scored_mask(
        self, xyz: NDArray[np.float32], true_ground: NDArray[np.bool_] | None
    ) -> NDArray[np.bool_]:
        """Says which points of a sweep are scored.

        Args:
            xyz: (N, 3) metres, sensor frame.
            true_ground: (N,) bool from the truth, None if there is none.

        Returns:
            (N,) bool.
        """
        kept = crop_mask(xyz, self.crop)
        if self.ground.remove and self.use_true_ground and true_ground is not None:
            kept &= ~true_ground
        elif self.ground.remove:
            inside = np.flatnonzero(kept)
            kept[inside[ground_mask(xyz[inside], self.ground)]] = False
        return kept

    def given_rows(self, scored: NDArray[np.bool_], stamp_ns: int) -> NDArray[np.int64]:
        """Chooses the points that the methods get.

        Args:
            scored: (N,) bool, see `scored_mask`.
            stamp_ns: Stamp of the sweep: each has its own random choice, the same in each run.

        Returns:
            (M,) ascending rows of the sweep.
        """
        rows = np.arange(len(scored)) if self.gives_all else np.flatnonzero(scored)
        if self.num_points is None or len(rows) <= self.num_points:
            return rows
        random = np.random.default_rng([self.seed, stamp_ns])
        return np.sort(random.choice(rows, self.num_points, replace=False))
