"""Faults that go on are logged at once, then at a low rate with their count."""

from __future__ import annotations

import re

from mnsf_ros.node.node_log import PERIOD_S, FaultLog


class Lines:
    """A logger that remembers."""

    def __init__(self):
        self.lines = []

    def warning(self, text):
        self.lines.append(f"warning: {text}")

    def error(self, text):
        self.lines.append(f"error: {text}")


def test_a_fault_of_an_hour_is_logged_again_with_its_count():
    logger, now_s = Lines(), [0.0]
    faults = FaultLog(logger, clock=lambda: now_s[0])
    for number in range(36_001):
        now_s[0] = number * 0.1
        faults.warn("undecodable", "a cloud cannot be decoded")
    assert len(logger.lines) == 1 + 3600 / PERIOD_S
    assert all(line.startswith("warning: a cloud cannot be decoded (") for line in logger.lines)
    counts = [re.search(r"\(([\d,]+) times since \d{4}-", line) for line in logger.lines[1:]]
    assert counts[0].group(1) == "6,001"
    assert counts[-1].group(1) == "36,001"


def test_kinds_are_counted_by_themselves():
    logger, now_s = Lines(), [0.0]
    faults = FaultLog(logger, clock=lambda: now_s[0])
    faults.warn("empty", "no point")
    faults.error("lost", "lost")
    assert [line.split(" (")[0] for line in logger.lines] == ["warning: no point", "error: lost"]
    now_s[0] = PERIOD_S
    faults.error("lost", "lost")
    assert logger.lines[2].startswith("error: lost (2 times since")


def test_a_fault_that_is_over_is_not_logged():
    logger, now_s = Lines(), [0.0]
    faults = FaultLog(logger, clock=lambda: now_s[0])
    faults.warn("empty", "no point")
    now_s[0] = 10 * PERIOD_S
    assert len(logger.lines) == 1
