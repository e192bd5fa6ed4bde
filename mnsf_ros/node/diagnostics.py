# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node's statuses on /diagnostics: input, flow, ego motion."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.node.node_log import FaultLog
from mnsf_ros.online.online_pipeline import (
    ESTIMATES_FAILED,
    SWEEPS_RECEIVED,
    TRIPLETS_UNWATCHED,
)
from mnsf_ros.online.online_statistics import StatisticsSnapshot
from mnsf_ros.online.watches import (
    CLOUDS_EMPTY,
    CLOUDS_MISSED,
    CLOUDS_UNDECODABLE,
    SWEEPS_LOST,
    FlowWatch,
)
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start

_LOST_SHARE: Final = 0.2  # of clouds lost to sweeps received; above it is an error


@dataclass(frozen=True)
class InputState:
    """State of the subscriptions to the lidars."""

    topic: str
    reliability: str
    num_publishers: int
    times: str = ""  # origin of the time of each point
    pause: str = ""  # reason for ignoring clouds; empty if they are not ignored
    missing: tuple[str, ...] = ()  # topics of lidars that are not in the last merged sweep


class Diagnostics:
    """Makes the statuses `input`, `flow` and `ego motion`; warns when input is silent."""

    def __init__(
        self, node_name: str, faults: FaultLog, find_topics: Callable[[], Sequence[str]]
    ) -> None:
        """`node_name` is the full name; `find_topics` returns the published topics of clouds."""
        self._node_name, self._faults, self._find_topics = node_name, faults, find_topics
        self._listens_since_s = time.monotonic()
        self._flow_watch = FlowWatch()
        self._last_counts: Counter[str] = Counter()
        self._new: Counter[str] = Counter()  # counts since the last statuses

    def statuses(
        self,
        snapshot: StatisticsSnapshot,
        state: InputState,
        load: int,
        settings: Settings,
    ) -> list[DiagnosticStatus]:
        """The statuses as of now; `load` is the number of triplets in the pipeline."""
        now_s, limits = time.monotonic(), settings.node
        self._new = snapshot.counts - self._last_counts
        self._last_counts = snapshot.counts
        statuses = [
            self._input_status(snapshot, state, limits.stale_after_s, now_s),
            self._flow_status(snapshot, load, settings, now_s),
            self._ego_motion_status(snapshot, settings.ego_motion.source),
        ]
        for status in statuses:
            status.hardware_id = state.topic
            if state.pause:
                status.level, status.message = DiagnosticStatus.OK, state.pause
        return statuses

    def _input_status(
        self, snapshot: StatisticsSnapshot, state: InputState, stale_after_s: float, now_s: float
    ) -> DiagnosticStatus:
        new, last_s = self._new, max(snapshot.arrivals_s, default=-math.inf)
        level = DiagnosticStatus.WARN
        if state.pause:
            self._listens_since_s = now_s
        if new[SWEEPS_LOST]:
            if new[SWEEPS_LOST] > _LOST_SHARE * new[SWEEPS_RECEIVED]:
                level = DiagnosticStatus.ERROR
            message = f"clouds are lost in transport (see {SWEEPS_LOST})"
        elif new[CLOUDS_UNDECODABLE]:
            message = "clouds that cannot be decoded"
        elif new[CLOUDS_EMPTY]:
            message = "clouds without a finite point"
        elif now_s - last_s > stale_after_s:
            level, message = DiagnosticStatus.STALE, f"no sweep on {state.topic}"
            self._tell_silence(message, max(last_s, self._listens_since_s), now_s, stale_after_s)
        elif state.missing:
            message = f"merged without {', '.join(state.missing)}"
        elif new[CLOUDS_MISSED]:
            message = f"clouds are missed (see {CLOUDS_MISSED})"
        else:
            level, message = DiagnosticStatus.OK, "receiving"
        rate_hz = snapshot.input_rate_hz(now_s)
        values = {
            "topic": state.topic,
            "publishers": state.num_publishers,
            "reliability": state.reliability,
            "rate [Hz]": f"{rate_hz:.2f}",
            "time of each point": state.times or "unknown",
            **_counts(snapshot, of_input=True),
        }
        return self._status("input", level, message, values)

    def _tell_silence(
        self, message: str, since_s: float, now_s: float, stale_after_s: float
    ) -> None:
        """Logs it once for each set of topics that are published instead."""
        if now_s - since_s <= stale_after_s:
            return
        topics = ", ".join(self._find_topics())
        advice = (
            f"PointCloud2 topics that are published: {topics}"
            if topics
            else "no PointCloud2 topic is published, see ROS_DOMAIN_ID if one should be"
        )
        self._faults.warn(f"silence {topics}", f"{message} for {now_s - since_s:.0f} s; {advice}")

    def _flow_status(
        self, snapshot: StatisticsSnapshot, load: int, settings: Settings, now_s: float
    ) -> DiagnosticStatus:
        limits = settings.node
        faults = self._flow_watch.look(snapshot, now_s, limits.stale_after_s)
        num_failed = snapshot.failures_in_a_row
        level = DiagnosticStatus.WARN
        if num_failed > limits.max_failures:
            level = DiagnosticStatus.ERROR
            message = (
                f"{num_failed} estimates failed in a row (see {ESTIMATES_FAILED} and last failure)"
            )
        elif faults.complaint:
            level, message = DiagnosticStatus.ERROR, faults.complaint
        elif num_failed:
            message = "the last estimate failed"
        elif faults.busy:
            message = faults.busy
        elif 0 < limits.max_latency_ms < snapshot.latency_ms(95):
            message = f"latency above {limits.max_latency_ms:g} ms (node.max_latency_ms)"
        else:
            idle_s = now_s - snapshot.recent[-1].finished_s if snapshot.recent else math.inf
            is_active = load > 0 or idle_s <= limits.stale_after_s
            level, message = DiagnosticStatus.OK, self._activity(is_active=is_active)
        values: dict[str, object] = {
            "rate [Hz]": f"{snapshot.flow_rate_hz(now_s):.2f}",
            "latency median [ms]": _number(snapshot.latency_ms(50)),
            "latency p95 [ms]": _number(snapshot.latency_ms(95)),
            "queue": max(0, load - 1),
            "busy": load > 0,
            "method": settings.method.name,
            **_counts(snapshot, of_input=False),
            "last failure": snapshot.last_failure or "none",
        }
        if snapshot.recent:
            values |= _recent_values(snapshot)
        return self._status("flow", level, message, values)

    def _ego_motion_status(self, snapshot: StatisticsSnapshot, wanted: str) -> DiagnosticStatus:
        sources = Counter(item.ego_source for item in snapshot.recent if item.ego_source)
        newest = snapshot.recent[-1].ego_source if snapshot.recent else ""
        level, message = DiagnosticStatus.OK, newest or "not estimated"
        if newest and newest not in (wanted, EgoSource.START.value):
            level, message = DiagnosticStatus.WARN, f"degraded: no {wanted}, {newest} instead"
        values = {
            "source": newest or "none",
            "wanted": wanted,
            **{f"{source}, recent": count for source, count in sorted(sources.items())},
        }
        return self._status("ego motion", level, message, values)

    def _activity(self, *, is_active: bool) -> str:
        if self._new[TRIPLETS_UNWATCHED]:
            return "resting: nobody subscribes to the flow"
        if is_active:
            return "estimating"
        return f"waiting for {'the third sweep' if self._new[SWEEPS_RECEIVED] else 'sweeps'}"

    def _status(
        self, part: str, level: bytes, message: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f"{self._node_name}: {part}",
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _counts(snapshot: StatisticsSnapshot, *, of_input: bool) -> dict[str, int]:
    return {
        event: count
        for event, count in sorted(snapshot.counts.items())
        if event.startswith(("sweeps_", "clouds_")) == of_input
    }


def _recent_values(snapshot: StatisticsSnapshot) -> dict[str, object]:
    estimates = [item.estimate for item in snapshot.recent]
    newest = estimates[-1]
    values: dict[str, object] = {
        "device": newest.device,
        "distance": newest.distance_kind,
        "precision": newest.precision,
        "start": newest.start.value,
        "cold starts, recent": sum(item.start is not Start.WARM for item in estimates),
        "estimate median [ms]": _number(snapshot.estimate_ms),
    }
    for stage in newest.times_ms:
        times = [item.times_ms[stage] for item in estimates if stage in item.times_ms]
        values[f"{stage} median [ms]"] = _number(float(np.median(times)))
    for stage, fit in newest.fits.items():
        fits = (item.fits[stage] for item in estimates if stage in item.fits)
        reasons = Counter(one.stop_reason.value for one in fits)
        values[f"{stage} iterations, last"] = fit.iterations
        values[f"{stage} stop reasons, recent"] = ", ".join(
            f"{reason} {count}" for reason, count in reasons.most_common()
        )
    return values


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "unknown"
