"""What the package logs without ROS, in the log of ROS."""

from __future__ import annotations

import logging
from typing import Any

PACKAGE = __name__.partition(".")[0]


class RosLogHandler(logging.Handler):
    """Hands records on to a logger of rclpy."""

    def __init__(self, logger: Any) -> None:  # noqa: ANN401 - rclpy's logger type moves about
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """Logs a record with the nearest severity."""
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        else:
            self._logger.info(text)


def log_to_ros(logger: Any) -> None:  # noqa: ANN401 - see above
    """Sends what the package logs from now on to a logger of rclpy, from `info` on."""
    own = logging.getLogger(PACKAGE)
    own.handlers = [RosLogHandler(logger)]
    own.setLevel(logging.INFO)
    own.propagate = False
