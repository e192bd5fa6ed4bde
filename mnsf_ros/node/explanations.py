# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Answers why a place of the last sweeps was called dynamic or static."""

from collections import deque
from typing import Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped
from rclpy.node import Node

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.reason_terms import reason_terms, rows_at
from mnsf_ros.errors import MnsfError
from mnsf_ros.sweeps.sweep import NANOSECONDS, SweepTriplet

# Sweeps that a question may be about: it comes a little later than the flow.
_KEPT: Final = 5


class Explanations:
    """A place on `~/explain` gives the terms of the decision about it on `~/explanation`.

    Estimates are kept for questions only while `~/explanation` has subscribers.
    """

    def __init__(self, node: Node) -> None:
        self._name = f"{node.get_fully_qualified_name().lstrip('/')}: explanation"
        self._estimates: deque[tuple[SweepTriplet, FlowEstimate]] = deque(maxlen=_KEPT)
        self._answers = node.create_publisher(DiagnosticArray, "~/explanation", 10)
        node.create_subscription(PointStamped, "~/explain", self._answer, 10)

    @property
    def are_watched(self) -> bool:
        """Whether answers have a subscriber."""
        return bool(self._answers.get_subscription_count() > 0)

    def keep(self, triplet: SweepTriplet, estimate: FlowEstimate) -> None:
        """Keeps an estimate for questions. May be called from any thread."""
        if self.are_watched:
            self._estimates.append((triplet, estimate))
        else:
            self._estimates.clear()

    def _answer(self, question: PointStamped) -> None:
        """Answers for the sweep nearest to the stamp; without a stamp, for the newest."""
        status = DiagnosticStatus(name=self._name, level=DiagnosticStatus.WARN)
        answer = DiagnosticArray(header=question.header, status=[status])
        asked_ns = question.header.stamp.sec * NANOSECONDS + question.header.stamp.nanosec
        estimates = [*self._estimates]
        if not estimates:
            status.message = "no sweep was estimated since this topic has a subscriber"
        else:
            triplet, estimate = min(
                reversed(estimates),
                key=lambda one: abs(one[0].current.stamp_ns - asked_ns) if asked_ns else 0,
            )
            answer.header = triplet.current.source.message.header
            self._explain(status, question, triplet, estimate)
        self._answers.publish(answer)

    def _explain(
        self,
        status: DiagnosticStatus,
        question: PointStamped,
        triplet: SweepTriplet,
        estimate: FlowEstimate,
    ) -> None:
        sweep, frame_id = triplet.current, question.header.frame_id
        if frame_id not in ("", sweep.frame_id):
            status.message = f"the place is in {frame_id!r}, expected {sweep.frame_id!r}"
            return
        try:
            rows = rows_at(sweep.xyz, estimate, (question.point.x, question.point.y))
            terms = reason_terms(sweep.xyz, estimate, rows, triplet.interval_s)
        except MnsfError as error:
            status.message = str(error)
            return
        status.level, status.message = DiagnosticStatus.OK, terms["Reason"]
        status.values = [KeyValue(key=term, value=text) for term, text in terms.items()]
