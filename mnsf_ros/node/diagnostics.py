# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node's statuses on /diagnostics: input, flow, ego motion, input check."""

import math
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from mnsf_ros.core.flow_estimate import Effort
from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.node.node_log import FaultLog
from mnsf_ros.settings import NodeSettings, Settings
from mnsf_ros.stream.pipeline import (
    ESTIMATES_FAILED,
    FLOWS_OUT,
    SWEEPS_RECEIVED,
    TRIPLETS_DROPPED,
    TRIPLETS_UNWATCHED,
    StatisticsSnapshot,
)
from mnsf_ros.sweeps.kept_points import boxes_around
from mnsf_ros.sweeps.sweep import Start

CLOUDS_UNDECODABLE: Final = "clouds_undecodable"
CLOUDS_EMPTY: Final = "clouds_empty"
CLOUDS_MISSED: Final = "clouds_missed"
SWEEPS_LOST: Final = "sweeps_lost_in_transport"

_ARRIVALS: Final = (SWEEPS_RECEIVED, CLOUDS_UNDECODABLE, CLOUDS_EMPTY)
# Signs that the node does what it should.
_WELL: Final = (FLOWS_OUT, TRIPLETS_UNWATCHED)
# Counter to what keeps the flow from coming if it grows.
REASONS: Final = {
    "sweeps_frame_changed": "frame_id changes from sweep to sweep, as of two lidars on one topic",
    "sweeps_duplicate": "sweeps have the same stamp",
    "sweeps_out_of_order": "stamps go backwards",
    "sweeps_time_went_back": "stamps jump back",
    "sweeps_gap": "sweeps are more than buffer.max_interval_s apart",
    CLOUDS_UNDECODABLE: "clouds cannot be decoded",
    CLOUDS_EMPTY: "clouds have no measured point",
    ESTIMATES_FAILED: "every estimate fails",
    TRIPLETS_DROPPED: "the estimate under way takes too long",
}

_LOST_SHARE: Final = 0.2  # of clouds lost to sweeps received; above it is an error
# Sweeps without ego motion are told as long as they are among so many, or among those since the
# last statuses if these are more.
_NUM_NEWEST: Final = 10
_WINDOW_S: Final = 10.0  # of rates
# Nodes need a while to find each other, and a program that publishes a recording to start.
FIRST_PATIENCE_S: Final = 10.0

_OK, _WARN, _ERROR, _STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
_LEVELS: Final = {Severity.WARNING: _WARN, Severity.ERROR: _ERROR}


@dataclass(frozen=True)
class InputState:
    """State of the subscriptions to the lidars."""

    topic: str
    reliability: str
    num_publishers: int
    times: str = ""  # origin of the time of each point
    pause: str = ""  # reason for ignoring clouds; empty if they are not ignored
    missing: tuple[str, ...] = ()  # topics of lidars that are not in the last merged sweep
    num_namesakes: int = 0  # other nodes of the same name
    num_parts: int = 1  # clouds in the last revolution
    mounting: str = "unknown"
    imu: str = "none"  # its frame and rate


class _Moment(NamedTuple):
    """The counters at one time of a steady clock."""

    time_s: float
    counts: Counter[str]


class Diagnostics:
    """Makes the statuses, and warns of silence and of findings in the input."""

    def __init__(
        self, node_name: str, faults: FaultLog, cause_of_silence: Callable[[], str]
    ) -> None:
        """Starts without any input; `faults` gets the warnings. The name is the full one."""
        self._node_name, self._faults = node_name, faults
        self._cause_of_silence = cause_of_silence
        start = _Moment(time.monotonic(), Counter())
        self._listens_since_s = start.time_s
        self._well = start  # the last moment with flow, or without a reason to expect any
        self._moments = deque([start])  # of the window, oldest first; the last one is now
        self._new: Counter[str] = Counter()  # counts since the last statuses

    def statuses(
        self,
        snapshot: StatisticsSnapshot,
        state: InputState,
        load: int,
        settings: Settings,
        findings: Sequence[Finding] | None = None,
    ) -> list[DiagnosticStatus]:
        """The statuses as of now.

        Args:
            snapshot: Counters and recent figures.
            state: State of the subscriptions.
            load: Number of triplets in the pipeline.
            settings: Those of the node.
            findings: What does not fit in the input, the worst first; None before enough sweeps.
        """
        self._look(snapshot, settings.node)
        if state.pause:
            self._listens_since_s = self._now_s
        statuses = [
            self._input_status(snapshot, state, settings.node),
            self._flow_status(snapshot, load, settings),
            self._ego_motion_status(snapshot, settings.ego_motion.source),
            self._input_check_status(findings),
        ]
        for status in statuses:
            status.hardware_id = state.topic
            if state.pause:
                status.level, status.message = _OK, state.pause
        return statuses

    def _look(self, snapshot: StatisticsSnapshot, limits: NodeSettings) -> None:
        now = _Moment(time.monotonic(), snapshot.counts)
        self._new = now.counts - self._moments[-1].counts
        self._moments.append(now)
        while len(self._moments) > 2 and self._moments[1].time_s <= now.time_s - _WINDOW_S:
            self._moments.popleft()
        last_s = max(snapshot.last_s.get(event, -math.inf) for event in _ARRIVALS)
        is_silent = now.time_s - last_s > limits.stale_after_s
        if is_silent or any(self._new[event] for event in _WELL):
            self._well = now

    @property
    def _now_s(self) -> float:
        return self._moments[-1].time_s

    def _rate_hz(self, event: str) -> float:
        first, last = self._moments[0], self._moments[-1]
        return (last.counts[event] - first.counts[event]) / max(last.time_s - first.time_s, 1e-9)

    def _input_status(
        self, snapshot: StatisticsSnapshot, state: InputState, limits: NodeSettings
    ) -> DiagnosticStatus:
        new, last_s = self._new, snapshot.last_s.get(SWEEPS_RECEIVED, -math.inf)
        lost = f"clouds are lost in transport (see {SWEEPS_LOST})"
        namesakes = f"{state.num_namesakes + 1} nodes have the name {self._node_name}"
        if state.num_namesakes:
            advice = "remap __node or __ns (launch: name:=, namespace:=)"
            text = f"{namesakes}, and publish on the same topics: {advice}"
            self._faults.warn("namesakes", text)
        level, message = _first(
            (new[SWEEPS_LOST] > _LOST_SHARE * new[SWEEPS_RECEIVED], _ERROR, lost),
            (new[SWEEPS_LOST], _WARN, lost),
            (new[CLOUDS_UNDECODABLE], _WARN, "clouds that cannot be decoded"),
            (new[CLOUDS_EMPTY], _WARN, "clouds without a measured point"),
            (self._now_s - last_s > limits.stale_after_s, _STALE, f"no sweep on {state.topic}"),
            (state.missing, _WARN, f"merged without {', '.join(state.missing)}"),
            (state.num_namesakes, _WARN, namesakes),
            (new[CLOUDS_MISSED], _WARN, f"clouds are missed (see {CLOUDS_MISSED})"),
            (True, _OK, "receiving"),
        )
        if level == _STALE:
            message += f": {self._cause_of_silence()}"
            silence_s = self._now_s - max(last_s, self._listens_since_s)
            first_s = 0.0 if SWEEPS_RECEIVED in snapshot.last_s else FIRST_PATIENCE_S
            if silence_s > max(first_s, limits.stale_after_s):
                self._faults.warn(message, f"{message} ({silence_s:.0f} s of silence)")
        values = {
            "topic": state.topic,
            "publishers": state.num_publishers,
            "reliability": state.reliability,
            "rate [Hz]": f"{self._rate_hz(SWEEPS_RECEIVED):.2f}",
            "time of each point": state.times or "unknown",
            "clouds of a revolution": state.num_parts,
            "mounting": state.mounting,
            "imu": state.imu,
            **_counts(snapshot, of_input=True),
        }
        return self._status("input", level, message, values)

    def _flow_status(
        self, snapshot: StatisticsSnapshot, load: int, settings: Settings
    ) -> DiagnosticStatus:
        limits, new, num_failed = settings.node, self._new, snapshot.failures_in_a_row
        idle_s = self._now_s - snapshot.last_s.get(FLOWS_OUT, -math.inf)
        is_ill = self._now_s - self._well.time_s > limits.stale_after_s
        is_idle = idle_s > limits.stale_after_s
        is_slow = not is_idle and 0 < limits.max_latency_ms < snapshot.latency_ms(95)
        failed = f"{num_failed} estimates failed in a row (see {ESTIMATES_FAILED} and last failure)"
        slowness = f"latency above {limits.max_latency_ms:g} ms (node.max_latency_ms)"
        level, message = _first(
            (num_failed > limits.max_failures, _ERROR, failed),
            (is_ill, _ERROR, self._no_flow_text()),
            (num_failed, _WARN, "the last estimate failed"),
            (new[TRIPLETS_DROPPED], _WARN, self._overload_text()),
            (new[TRIPLETS_UNWATCHED], _OK, "resting: nobody subscribes to the flow"),
            (is_slow, _WARN, slowness),
            (load > 0 or not is_idle, _OK, "estimating"),
            (new[SWEEPS_RECEIVED], _OK, "waiting for the third sweep"),
            (True, _OK, "waiting for sweeps"),
        )
        values: dict[str, object] = {
            "rate [Hz]": f"{self._rate_hz(FLOWS_OUT):.2f}",
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

    def _no_flow_text(self) -> str:
        growth = self._moments[-1].counts - self._well.counts
        name = max(REASONS, key=lambda name: growth[name])
        if not growth[name]:
            return "clouds come in, but no flow goes out"
        return f"no flow: {REASONS[name]} (see {name})"

    def _overload_text(self) -> str:
        recent = self._moments[-1].counts - self._moments[0].counts
        flows, cores = recent[FLOWS_OUT], os.cpu_count() or 1
        load = f"load {os.getloadavg()[0]:.1f}, cores {cores}"
        possible = flows + recent[TRIPLETS_DROPPED]
        advice = "Close other programs, or lower crop.max_range_m."
        return f"CPU busy: {flows} of {possible} flows ({load}). {advice}"

    def _ego_motion_status(self, snapshot: StatisticsSnapshot, wanted: str) -> DiagnosticStatus:
        sources = Counter(item.ego_source for item in snapshot.recent if item.ego_source)
        newest = snapshot.recent[-1].ego_source if snapshot.recent else ""
        few = snapshot.recent[-max(_NUM_NEWEST, self._new[FLOWS_OUT]) :]
        num_lost = sum(bool(item.lost) for item in few)
        lost = f"lost: {snapshot.lost}; nothing counts as moving until it is found again"
        again = f"found again: it was lost in {num_lost} of the last {len(few)} sweeps"
        is_resting = self._new[TRIPLETS_UNWATCHED] and not self._new[FLOWS_OUT]
        if snapshot.lost:
            self._faults.warn(f"ego motion {snapshot.lost}", f"ego motion is {lost}")
        level, message = _first(
            (not newest or is_resting, _OK, "not estimated"),
            (snapshot.lost, _ERROR, lost),
            (num_lost, _WARN, again),
            (newest in (wanted, EgoSource.START.value), _OK, newest),
            (True, _WARN, f"degraded: no {wanted}, {newest} instead"),
        )
        since_s = snapshot.lost_since_s
        values = {
            "source": newest or "none",
            "wanted": wanted,
            "lost": snapshot.lost or "no",
            "lost for [s]": _number(0.0 if since_s is None else self._now_s - since_s),
            "sweeps lost, recent": sum(bool(item.lost) for item in snapshot.recent),
            **{f"{source}, recent": count for source, count in sorted(sources.items())},
        }
        return self._status("ego motion", level, message, values)

    def _input_check_status(self, findings: Sequence[Finding] | None) -> DiagnosticStatus:
        if findings is None:
            return self._status("input check", _OK, "waiting for more sweeps", {})
        wrong = [finding for finding in findings if finding.is_wrong]
        for finding in wrong:
            self._faults.warn(finding.assumption, str(finding))
        message = str(wrong[0]) if wrong else "nothing wrong was found"
        if len(wrong) > 1:
            message += f" (and {len(wrong) - 1} more)"
        level = _LEVELS[wrong[0].severity] if wrong else _OK
        values = {finding.assumption: finding for finding in findings}
        return self._status("input check", level, message, values)

    def _status(
        self, part: str, level: bytes, message: str, values: Mapping[str, object]
    ) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f"{self._node_name}: {part}",
            message=message,
            # What a method does not have is left out.
            values=[KeyValue(key=k, value=text) for k, v in values.items() if (text := str(v))],
        )


def _first(*conditions: tuple[object, bytes, str]) -> tuple[bytes, str]:
    """Level and message of the first condition that holds."""
    return next((level, message) for holds, level, message in conditions if holds)


def _counts(snapshot: StatisticsSnapshot, *, of_input: bool) -> dict[str, int]:
    return {
        event: count
        for event, count in sorted(snapshot.counts.items())
        if event.startswith(("sweeps_", "clouds_", "imu_")) == of_input
    }


def _recent_values(snapshot: StatisticsSnapshot) -> dict[str, object]:
    estimates = [item.estimate for item in snapshot.recent]
    newest = estimates[-1]
    values: dict[str, object] = {
        "device": newest.device,
        "distance": newest.distance_kind,
        "precision": newest.precision,
        "start": newest.start.value,
        "own body": newest.own_body_text,
        "own body boxes": boxes_around(newest.own_body),
        "cold starts, recent": sum(item.start is not Start.WARM for item in estimates),
        "effort": newest.effort.text,
        "with less effort, recent": sum(item.effort is not Effort.FULL for item in estimates),
        "estimate median [ms]": _number(snapshot.estimate_ms),
    }
    for stage in newest.times_ms:
        times = [item.times_ms[stage] for item in estimates if stage in item.times_ms]
        values[f"{stage} median [ms]"] = _number(float(np.median(times)))
    for stage, reason in newest.stop_reasons.items():
        values[f"{stage} stop reason"] = reason
    return values


def _number(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "unknown"
