# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node's statuses on /diagnostics: input, flow, ego motion."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from mnsf_ros.ego_motion.ego_motion import EgoSource
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
    BusyWatch,
    FlowWatch,
)
from mnsf_ros.settings import Settings

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
    """Makes the statuses `input`, `flow` and `ego motion`; remembers the last counts."""

    def __init__(self, node_name: str) -> None:
        """`node_name` is the full name, with the namespace."""
        self._node_name = node_name
        self._last_counts: Mapping[str, int] = {}
        self._flow_watch = FlowWatch()
        self._busy_watch = BusyWatch()

    def statuses(
        self,
        snapshot: StatisticsSnapshot,
        state: InputState,
        load: int,
        settings: Settings,
    ) -> list[DiagnosticStatus]:
        """The statuses as of now; `load` is the number of triplets in the pipeline."""
        now_s, limits = time.monotonic(), settings.node
        statuses = [
            self._input_status(snapshot, state, limits.stale_after_s, now_s),
            self._flow_status(snapshot, load, settings, now_s),
            self._ego_motion_status(snapshot, settings.ego_motion.source),
        ]
        for status in statuses:
            status.hardware_id = state.topic
            if state.pause:
                status.level, status.message = DiagnosticStatus.OK, state.pause
        self._last_counts = snapshot.counts
        return statuses

    def _input_status(
        self, snapshot: StatisticsSnapshot, state: InputState, stale_after_s: float, now_s: float
    ) -> DiagnosticStatus:
        arrivals_s = snapshot.arrivals_s
        silence_s = now_s - arrivals_s[-1] if arrivals_s else float("inf")
        num_lost, num_received = (
            self._new(snapshot, SWEEPS_LOST),
            self._new(snapshot, SWEEPS_RECEIVED),
        )
        if num_lost:
            is_usual = num_lost > _LOST_SHARE * num_received
            level = DiagnosticStatus.ERROR if is_usual else DiagnosticStatus.WARN
            message = f"clouds are lost in transport (see {SWEEPS_LOST})"
        elif self._new(snapshot, CLOUDS_UNDECODABLE):
            level, message = DiagnosticStatus.WARN, "clouds that cannot be decoded"
        elif self._new(snapshot, CLOUDS_EMPTY):
            level, message = DiagnosticStatus.WARN, "clouds without a finite point"
        elif silence_s > stale_after_s:
            level, message = DiagnosticStatus.STALE, f"no sweep on {state.topic}"
        elif state.missing:
            level, message = DiagnosticStatus.WARN, f"merged without {', '.join(state.missing)}"
        elif self._new(snapshot, CLOUDS_MISSED):
            level, message = DiagnosticStatus.WARN, f"clouds are missed (see {CLOUDS_MISSED})"
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

    def _flow_status(
        self, snapshot: StatisticsSnapshot, load: int, settings: Settings, now_s: float
    ) -> DiagnosticStatus:
        limits = settings.node
        idle_s = now_s - snapshot.recent[-1].finished_s if snapshot.recent else float("inf")
        complaint = self._flow_watch.complaint(snapshot.counts, now_s, limits.stale_after_s)
        error = _failures(snapshot.failures_in_a_row, limits.max_failures) or complaint
        if error:
            level, message = DiagnosticStatus.ERROR, error
        elif warning := self._flow_warning(snapshot, limits.max_latency_ms, now_s):
            level, message = DiagnosticStatus.WARN, warning
        else:
            is_active = load > 0 or idle_s <= limits.stale_after_s
            level, message = DiagnosticStatus.OK, self._activity(snapshot, is_active=is_active)
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

    def _flow_warning(
        self, snapshot: StatisticsSnapshot, max_latency_ms: float, now_s: float
    ) -> str:
        if snapshot.failures_in_a_row:
            return "the last estimate failed"
        if busy := self._busy_watch.warning(snapshot, now_s):
            return busy
        if max_latency_ms and snapshot.latency_ms(95) > max_latency_ms:
            return f"latency above {max_latency_ms:g} ms (node.max_latency_ms)"
        return ""

    def _activity(self, snapshot: StatisticsSnapshot, *, is_active: bool) -> str:
        if self._new(snapshot, TRIPLETS_UNWATCHED):
            return "resting: nobody subscribes to the flow"
        if is_active:
            return "estimating"
        waiting = "for the third sweep" if self._new(snapshot, SWEEPS_RECEIVED) else "for sweeps"
        return f"waiting {waiting}"

    def _new(self, snapshot: StatisticsSnapshot, event: str) -> int:
        return snapshot.counts.get(event, 0) - self._last_counts.get(event, 0)

    def _status(
        self, part: str, level: bytes, message: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f"{self._node_name}: {part}",
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def _failures(num_in_a_row: int, max_failures: int) -> str:
    if num_in_a_row <= max_failures:
        return ""
    return f"{num_in_a_row} estimates failed in a row (see {ESTIMATES_FAILED} and last failure)"


def _counts(snapshot: StatisticsSnapshot, *, of_input: bool) -> dict[str, int]:
    return {
        event: count
        for event, count in sorted(snapshot.counts.items())
        if event.startswith(("sweeps_", "clouds_")) == of_input
    }


def _recent_values(snapshot: StatisticsSnapshot) -> dict[str, object]:
    newest = snapshot.recent[-1]
    values: dict[str, object] = {
        "device": newest.device,
        "distance": newest.distance_kind,
        "precision": newest.precision,
        "start": newest.start,
        "cold starts, recent": sum(item.start != "warm" for item in snapshot.recent),
    }
    values["estimate median [ms]"] = _number(snapshot.estimate_ms)
    for stage in newest.times_ms:
        times = [item.times_ms[stage] for item in snapshot.recent if stage in item.times_ms]
        values[f"{stage} median [ms]"] = _number(float(np.median(times)))
    for stage, iterations in newest.iterations.items():
        reasons = Counter(
            item.stop_reasons[stage] for item in snapshot.recent if stage in item.stop_reasons
        )
        values[f"{stage} iterations, last"] = iterations
        values[f"{stage} stop reasons, recent"] = ", ".join(
            f"{reason} {count}" for reason, count in reasons.most_common()
        )
    return values


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "unknown"
