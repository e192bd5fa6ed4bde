# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node's log: its settings, faults, and the records of the package."""

import logging
import traceback
from typing import Any, Final, TypeAlias

from rclpy.logging import get_logger

from mnsf_ros.presets import nearest_preset
from mnsf_ros.settings import Settings

PERIOD_S: Final = 600.0
_PACKAGE: Final = __name__.partition(".")[0]
_FRAMES_SHOWN: Final = 3

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
    """Sends the package's records, from `info` on, to a logger of rclpy."""
    own = logging.getLogger(_PACKAGE)
    own.handlers = [_RosLogHandler(logger)]
    own.setLevel(logging.INFO)
    own.propagate = False


def greeting(settings: Settings) -> str:
    """Returns one line: the nearest preset and its changes, device, threads, ego motion."""
    name, changed = nearest_preset(settings, ("compute.num_threads",))
    if changed:
        name += f" but for {', '.join(changed)}"
    threads = settings.compute.num_threads
    return (
        f"preset {name}, method {settings.method.name}, device {settings.compute.device}, "
        f"{threads} thread{'s'[: threads != 1]}, ego motion from {settings.ego_motion.source}"
    )


class FaultLog:
    """Logs each kind of fault at most every ten minutes; may be used from any thread."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._loggers: dict[str, Logger] = {}

    def warn(self, kind: str, text: str) -> None:
        """Warns of a fault, unless one of its kind was logged lately."""
        self._logger(kind).warning(f"{text} {_OFTEN}", throttle_duration_sec=PERIOD_S)

    def inform(self, kind: str, text: str) -> None:
        """Tells of what is no fault by itself, likewise."""
        self._logger(kind).info(f"{text} {_OFTEN}", throttle_duration_sec=PERIOD_S)

    def unexpected(self, what: str, error: Exception) -> None:
        """Logs an error that is a defect, with its traceback; one of ROS alone is one line."""
        frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
        where = ", ".join(frame.f_code.co_name for frame in frames[-_FRAMES_SHOWN:])
        name = type(error).__name__
        # The first one has caught it.
        if any(_PACKAGE in frame.f_globals.get("__name__", "") for frame in frames[1:]):
            details = "".join(traceback.format_exception(error))
            text = f"unexpected error\n{details}"
        else:
            text = f"refused by ROS in {where}: {name}: {error}"
        logger = self._logger(f"{where} {name}")
        logger.error(f"{what}: {text} {_OFTEN}", throttle_duration_sec=PERIOD_S)

    def _logger(self, kind: str) -> Logger:
        # rclpy throttles each line of a program, and each logger by itself.
        if kind not in self._loggers:
            self._loggers[kind] = get_logger(self._name)
        return self._loggers[kind]


_OFTEN: Final = f"(at most every {PERIOD_S / 60:.0f} min, counted in /diagnostics)"
