# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""MNSF at the rate of the sensor: networks that live from sweep to sweep.

Section 3 of the paper, where something may move: a forward field, a backward field, inversion and
a learned fusion, each fitted by a few steps that start from the weights of the last triplet. Ego
motion, ground, objects, the gate, tracks and the output are those of the online method: an object
that passes the gate has the mean of the fused flow at a few of its points, and may turn.
"""

from collections.abc import Callable, Iterator, MutableMapping
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.compute_device import (
    compute_device,
    layer_precision,
    on_device,
    one_thread,
)
from mnsf_ros.core.flow_estimate import Effort, FlowEstimate, OptimizationResult
from mnsf_ros.core.scene_flow_estimator import never
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.errors import OptimizationError
from mnsf_ros.methods.live_fit import LiveFit
from mnsf_ros.networks.target_distance import TargetDistance
from mnsf_ros.networks.warm_networks import WarmNetworks
from mnsf_ros.online.first_guess import with_better_guesses
from mnsf_ros.online.motions import judge
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.preparation import PreparedSweeps, Scene
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.target import Target
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start, SweepTriplet


class LiveMnsfEstimator(ObjectFlowEstimator):
    """Estimates scene flow as ego motion plus the flow of warm-started networks.

    `prepare` and `estimate` may run in two threads.
    """

    def __init__(self, settings: Settings, track_ids: Iterator[int] | None = None) -> None:
        """Makes an estimator that has seen nothing yet, see `ObjectFlowEstimator`.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        super().__init__(settings, track_ids)
        self._networks: WarmNetworks | None = None
        # Of the sweeps that may be a target again, as long as these are kept.
        self._distances: MutableMapping[ObjectSweep, TargetDistance] = WeakKeyDictionary()
        self._fits: dict[str, OptimizationResult] = {}
        self._kinds: set[str] = set()

    def estimate(
        self,
        triplet: SweepTriplet,
        cancelled: Callable[[], bool] = never,
        prepared: PreparedSweeps | None = None,
        effort: Effort = Effort.FULL,
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep, see `ObjectFlowEstimator`.

        Raises:
            SweepError: If too few points of a sweep are left.
            OptimizationError: If a loss is not finite; the next triplet starts from scratch.
            CancelledError: If `cancelled` says so.
        """
        if not self.settings.warm_start.enabled:
            self._networks = None
        self._fits, self._kinds = {}, set()
        are_fresh = self._networks is None or not self._networks.fitted
        with one_thread():
            estimate = super().estimate(triplet, cancelled, prepared, effort)
        # Tracks may be warm while networks are fresh: after a failed fit.
        is_cold = estimate.start is Start.WARM and are_fresh and bool(self._fits)
        return replace(
            estimate,
            start=Start.COLD_NETWORKS if is_cold else estimate.start,
            fits=self._fits,
            device=compute_device(self.settings.compute).type,
            precision=str(layer_precision(self.settings.compute)).removeprefix("torch."),
            distance_kind=", ".join(sorted(self._kinds)),
        )

    def find_motions(self, table: ObjectTable, scene: Scene, clock: StageClock) -> ObjectTable:
        """Fits the networks, and rejects suspects that their flow does not explain better.

        Raises:
            OptimizationError: If a loss or the flow is not finite.
        """
        suspects = table.select(table.open_rows)
        motions = self._fitted(suspects.points, scene, clock)
        with clock.stage("residuals"):
            some = suspects.points.thinner()
            judged = judge(some, scene.targets, motions)
            table = with_better_guesses(table, judged, scene.targets)
            rows = table.open_rows
            kept = table.select(rows)
            return table.put(rows, fitted=judge(kept.points, scene.targets, kept.first_guess))

    def _fitted(self, objects: ObjectPoints, scene: Scene, clock: StageClock) -> Floats32:
        """The motions of K objects, (K, 3) metres to the next sweep, by the fitted networks."""
        if len(objects) == 0:
            return np.zeros((0, 3), np.float32)
        if self._networks is None:
            self._networks = WarmNetworks(self.settings)
        fit = LiveFit(
            self._networks, objects, scene, self._distance_to, self.settings, clock.cancelled
        )
        try:
            motions = fit.run(clock)
        except OptimizationError:
            self._networks = None
            raise
        self._fits = fit.fits
        return motions

    def _distance_to(self, target: Target) -> TargetDistance:
        """D(p, S) of a sweep, built once."""
        sweep = target.sweep
        distance = self._distances.get(sweep)
        if distance is None:
            points = on_device(sweep.thinned, compute_device(self.settings.compute))
            distance = TargetDistance(points, self.settings.distance)
            self._distances[sweep] = distance
        self._kinds.add(distance.kind)
        return distance
