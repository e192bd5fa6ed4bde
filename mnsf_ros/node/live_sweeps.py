# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The sweeps of a live topic, as the node takes them, for a while."""

import time
from collections import deque
from collections.abc import Iterator
from typing import Final

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.diagnostics import FIRST_PATIENCE_S
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.node.subscriptions import Report
from mnsf_ros.node.sweep_input import SweepInput
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep

_SPIN_S: Final = 0.1
# Nodes of Fast DDS announce themselves every 3 s, and more often at first.
_DISCOVERY_S: Final = 3.0


def live_sweeps(
    topic: str, odometry: str | None, settings: Settings, duration_s: float, report: Report
) -> Iterator[tuple[Sweep, int]]:
    """Yields the sweeps of a topic with the number of their clouds, so long from the first one on.

    Odometry is waited for where the settings ask for it. `report` gets what is noticed.

    Raises:
        SettingsError: There is no such topic, or nothing comes.
    """
    with RawTopics("mnsf_doctor", points=topic, odometry=odometry or "~/odometry") as ros:
        found: deque[tuple[Sweep, int]] = deque()
        source = SweepInput(
            ros.node, settings, report, lambda sweep, _: found.append((sweep, source.num_parts))
        )
        begun_s, patience_s, is_silent = time.monotonic(), _DISCOVERY_S, True
        while time.monotonic() < begun_s + patience_s:
            ros.spin_for(_SPIN_S)
            if is_silent and ros.node.count_publishers(topic):
                patience_s = FIRST_PATIENCE_S
            if found and is_silent:
                begun_s, patience_s, is_silent = time.monotonic(), duration_s, False
            while found:
                yield found.popleft()
            source.refresh()
        cause = source.silence
    if is_silent:
        raise SettingsError(
            f"{topic}: no such recording, and no cloud came on this topic within "
            f"{patience_s:g} s; {cause}"
        )
