# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the node says in the log of ROS: its settings, faults, silence, and what the package logs.

Faults may come ten times a second: each kind is logged at once, then at a low rate.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from mnsf_ros.presets import nearest_preset
from mnsf_ros.settings import Settings

if TYPE_CHECKING:
    from mnsf_ros.node.diagnostics import InputState

PERIOD_S: Final = 600.0
_PACKAGE: Final = __name__.partition(".")[0]
_MOST_NAMES: Final = 6
_MOST_TOPICS: Final = 20

# rclpy's logger, whose type moves about.
Logger: TypeAlias = Any


class _RosLogHandler(logging.Handler):
    """Hands records on to a logger of rclpy, with the nearest severity."""

    def __init__(self, logger: Logger) -> None:
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)


def log_to_ros(logger: Logger) -> None:
    """Sends what the package logs from now on to a logger of rclpy, from `info` on."""
    own = logging.getLogger(_PACKAGE)
    own.handlers = [_RosLogHandler(logger)]
    own.setLevel(logging.INFO)
    own.propagate = False


def greeting(settings: Settings) -> str:
    """Returns one line: the nearest preset and what differs, device, threads, ego motion."""
    name, changed = nearest_preset(settings, ("compute.num_threads",))
    threads = settings.compute.num_threads
    return (
        f"preset {name}{_but(changed)}, method {settings.method.name}, "
        f"device {settings.compute.device}, {threads} thread{'s'[: threads != 1]}, "
        f"ego motion from {settings.ego_motion.source}"
    )


def _but(changed: Collection[str]) -> str:
    if not changed:
        return ""
    if len(changed) > _MOST_NAMES:
        return f" with {len(changed)} changes"
    return f" but for {', '.join(changed)}"


@dataclass
class _Repeated:
    """Something that is said at once, then every ten minutes at the earliest."""

    said_s: float = -math.inf

    def is_due(self, now_s: float) -> bool:
        """Whether to say it now; if so, it counts as said."""
        if now_s - self.said_s < PERIOD_S:
            return False
        self.said_s = now_s
        return True


@dataclass
class _Fault(_Repeated):
    """What is known of one kind of fault."""

    since: str = ""
    count: int = 0


class FaultLog:
    """Wraps a logger of rclpy; may be used from any thread.

    A fault is logged when it happens first. While it goes on it is logged again every ten minutes,
    with the number of times that it has happened.
    """

    def __init__(self, logger: Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger = logger
        self._clock = clock
        self._lock = threading.Lock()
        self._faults: dict[str, _Fault] = {}

    def warn(self, kind: str, text: str) -> None:
        """Warns of a fault, if it is time to."""
        if suffix := self._suffix(kind):
            self._logger.warning(f"{text} {suffix}")

    def error(self, kind: str, text: str) -> None:
        """Logs an error, if it is time to."""
        if suffix := self._suffix(kind):
            self._logger.error(f"{text} {suffix}")

    def _suffix(self, kind: str) -> str:
        """What to add to the text; empty if nothing is to be said now."""
        now_s = self._clock()
        with self._lock:
            if kind not in self._faults:
                since = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S")
                self._faults[kind] = _Fault(since=since)
            fault = self._faults[kind]
            fault.count += 1
            if not fault.is_due(now_s):
                return ""
        if fault.count == 1:
            return f"(at most every {PERIOD_S / 60:.0f} min, counted in /diagnostics)"
        return f"({fault.count:,} times since {fault.since})"


class SilenceLog:
    """Logs one warning when no sweep comes for long, and one line when sweeps come.

    The warning is repeated after ten minutes at the earliest, as those of `FaultLog`, and once a
    topic appears that it has not named: discovery takes seconds, a driver may start later.
    """

    def __init__(
        self,
        logger: Logger,
        find_topics: Callable[[], Sequence[str]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`find_topics` returns the topics of clouds that are published."""
        self._logger, self._find_topics, self._clock = logger, find_topics, clock
        self._start_s = clock()
        self._repeated = _Repeated()
        self._named: set[str] = set()
        self._is_waiting = True

    def look(self, arrivals_s: Sequence[float], state: InputState, stale_after_s: float) -> None:
        """Logs what is to be said now; `arrivals_s` are the times of the last sweeps."""
        now_s = self._clock()
        if state.pause:
            # Silence counts from the end of the pause on.
            self._start_s = now_s
            return
        last_s = max(self._start_s, arrivals_s[-1]) if arrivals_s else self._start_s
        if now_s - last_s > stale_after_s:
            topics = self._find_topics()
            if self._has_unnamed(topics) or self._repeated.is_due(now_s):
                self._repeated.said_s = now_s
                self._named.update(topics)
                self._logger.warning(_silence(state, now_s - last_s, topics))
                self._is_waiting = True
        elif self._is_waiting and last_s > self._start_s:
            self._logger.info(f"sweeps come on {state.topic}")
            self._is_waiting = False

    def _has_unnamed(self, topics: Sequence[str]) -> bool:
        # Bounded, so that topics that come and go do not fill the log.
        return len(self._named) < _MOST_TOPICS and not self._named.issuperset(topics)


def _silence(state: InputState, silence_s: float, topics: Sequence[str]) -> str:
    advice = (
        f"PointCloud2 topics that are published: {', '.join(topics)}"
        if topics
        else "no PointCloud2 topic is published, see ROS_DOMAIN_ID if one should be"
    )
    return (
        f"no sweep on {state.topic} for {silence_s:.0f} s; {advice} "
        f"(at most every {PERIOD_S / 60:.0f} min)"
    )
