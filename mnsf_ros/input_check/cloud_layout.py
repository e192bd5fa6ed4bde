# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Assumption: the layout of a cloud is what its message says; rays without return are no points."""

from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.input_check.assumption import Assumption
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.sweep_sample import SweepSample

_ASSUMPTION: Final = "clouds are laid out as their messages say"


class CloudLayout(Assumption):
    """Describes the messages of clouds, and counts those whose lengths contradict each other."""

    def __init__(self) -> None:
        self._text, self._frames = "", dict[str, None]()
        self._num, self._num_odd = 0, 0
        self._lost: deque[float] = deque(maxlen=100)  # share of rays without a return

    def add(self, sample: SweepSample) -> None:
        """Takes the next sweep."""
        if len(self._frames) < 5:
            self._frames[sample.sweep.frame_id] = None
        if sample.cloud is None:
            return
        message, self._num = sample.cloud.message, self._num + 1
        num_returns = len(sample.sweep) + sample.cloud.num_untimed
        self._lost.append(1 - num_returns / max(len(sample.cloud.measured), 1))
        self._num_odd += message.row_step != message.width * message.point_step
        if not self._text:
            names = " ".join(field.name for field in message.fields)
            order = "big" if message.is_bigendian else "little"
            shape = f"{message.height} x {message.width} points"
            self._text = f"{shape} of {message.point_step} bytes, {order} endian: {names}"

    def facts(self) -> dict[str, str]:
        """Frame, fields and no-returns, in words."""
        facts = {"frame": ", ".join(filter(None, self._frames)) or "none"}
        if not self._lost:
            return facts
        facts["cloud"] = self._text
        if (lost := f"{np.median(self._lost):.1%}") != "0.0%":
            facts["no returns"] = f"{lost} of the points, left out"
        return facts

    def findings(self) -> Iterator[Finding]:
        """Yields what does not fit."""
        if self._num_odd:
            found = f"row_step is not width * point_step in {self._num_odd} of {self._num} clouds"
            remedy = "Nothing needs doing: it is ignored, as the lengths agree"
            yield Finding(_ASSUMPTION, Severity.INFO, found, remedy)
        if len(self._frames) > 1:
            found = f"clouds have different frames: {', '.join(self._frames)}"
            remedy = "Publish each lidar on a topic of its own (lidars.count)"
            yield Finding(_ASSUMPTION, Severity.ERROR, found, remedy)
