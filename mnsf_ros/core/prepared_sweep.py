"""A sweep made ready for the estimate: its kept points, on the device, with its D."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import compute_device
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.errors import SweepError
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import crop_mask, kept_mask
from mnsf_ros.sweeps.sweep import Sweep

_MIN_POINTS = 10


class PreparedSweep:
    """What the estimate needs of one sweep. Built once, used as next, current and previous.

    Attributes:
        kept: (N,) bool, the points that fields are fitted to: those inside the crop that the
            caller has chosen, or that are not ground.
        points: (M, 3) float32 on the device, metres, the kept points.
    """

    def __init__(self, sweep: Sweep, settings: Settings) -> None:
        """Chooses the points.

        Raises:
            SweepError: If too few points are left.
        """
        self._is_chosen = sweep.kept is not None
        self.kept = (
            kept_mask(sweep.xyz, settings)
            if sweep.kept is None
            else sweep.kept & crop_mask(sweep.xyz, settings.crop)
        )
        num_kept = int(np.count_nonzero(self.kept))
        if num_kept < _MIN_POINTS:
            raise SweepError(
                f"sweep {sweep.stamp_ns}: {num_kept} of {len(sweep)} points are left after crop "
                f"and ground removal, expected at least {_MIN_POINTS}"
            )
        self._xyz = sweep.xyz
        self._settings = settings.distance
        self.points = torch.from_numpy(sweep.xyz[self.kept]).to(compute_device(settings.compute))

    @cached_property
    def positions(self) -> torch.Tensor:
        """(P, 3) where the fields are evaluated: all points, or the kept ones if chosen.

        A network says nothing sensible far from what it was fitted to, so a point that was
        cropped takes the flow of the nearest place in the box around the kept points.
        """
        if self._is_chosen:
            return self.points
        low, high = self.points.min(dim=0).values, self.points.max(dim=0).values
        all_points = torch.tensor(self._xyz, device=self.points.device)
        return torch.minimum(torch.maximum(all_points, low), high)

    @property
    def kept_positions(self) -> torch.Tensor:
        """(M,) indices of the kept points among `positions`, on the CPU."""
        if self._is_chosen:
            return torch.arange(len(self.points))
        return torch.from_numpy(self.kept).nonzero().view(-1)

    def whole(self, flow: torch.Tensor) -> NDArray[np.float32]:
        """Returns the flow at `positions` (P, 3) for all points (N, 3); NaN where not asked for."""
        if not self._is_chosen:
            return flow.cpu().numpy()
        whole = np.full(self._xyz.shape, np.nan, dtype=np.float32)
        whole[self.kept] = flow.cpu().numpy()
        return whole

    @cached_property
    def distance(self) -> TargetDistance:
        """D(p, S) with this sweep as the target S."""
        return TargetDistance.to_points(self.points, self._settings)


class SweepPreparation:
    """Prepares sweeps and remembers them as long as they are in the triplet at hand."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._prepared: dict[Sweep, PreparedSweep] = {}

    def prepare(self, *sweeps: Sweep) -> list[PreparedSweep]:
        """The prepared sweeps, in the order given; those not among them are forgotten."""
        self._prepared = {
            sweep: self._prepared.get(sweep) or PreparedSweep(sweep, self._settings)
            for sweep in sweeps
        }
        return [self._prepared[sweep] for sweep in sweeps]
