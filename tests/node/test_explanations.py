# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`~/explain` and `~/explanation`: the terms of the decision about a place."""

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped
from moving_boxes import surfaces
from node_harness import Spinner, stamp_of
from synthetic_clouds import over_ground, tracked, xyz_message

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.reason import Leader, Match, Reason, SweepTerms, Verdict
from mnsf_ros.node.explanations import Explanations
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import CloudReader

NUM_POINTS = 600
STATES = np.array([2, 2, 2, 3], np.uint8)
NEXT = SweepTerms(
    0.1, np.zeros((0, 3), np.float32), Match(np.zeros((4, 3), np.float32), STATES, 0.25), None
)


class Asking(Spinner):
    """The explanations under test, and a subscriber and a publisher of the same node."""

    def __init__(self):
        super().__init__("asking")
        self.explanations = Explanations(self.node)
        self._questions = self.node.create_publisher(PointStamped, "~/explain", 10)
        self._answers = []

    def listen(self):
        self.node.create_subscription(DiagnosticArray, "~/explanation", self._answers.append, 10)
        self.spin_until(
            lambda: self.node.count_subscribers("/asking/explanation") == 1, "the subscription"
        )
        self.spin_until(self._questions.get_subscription_count, "the node")

    def ask(self, x, y, stamp_s=0, frame_id=""):
        """The answer to a question: its stamp in seconds, and its status."""
        before = len(self._answers)
        question = PointStamped()
        question.header.frame_id, question.header.stamp.sec = frame_id, stamp_s
        question.point.x, question.point.y = x, y
        self._questions.publish(question)
        self.spin_until(lambda: len(self._answers) > before, "an answer")
        answer = self._answers[-1]
        return stamp_of(answer) // 10**9, answer.status[0]


@pytest.fixture
def asking(ros):
    asking = Asking()
    yield asking
    asking.close()


def estimated(stamp_s, **changes):
    """A triplet at a stamp, and an estimate whose reasons are the number of points asked for."""
    sweeps = [
        CloudReader().sweep(
            xyz_message(surfaces(0, NUM_POINTS), stamp_ns=(stamp_s + index) * 10**9),
            Settings().time,
            0,
        )
        for index in (-1, 0, 1)
    ]
    track_ids = np.zeros(NUM_POINTS, np.int32)
    track_ids[:40] = 5
    item = replace(tracked(5), center=np.array([500.0, 0.0, 0.0]), size=np.full(3, 4.0))
    known = over_ground(
        motion=np.zeros((NUM_POINTS, 3), np.float32),
        dynamic=track_ids > 0,
        confidence=np.ones(NUM_POINTS, np.float32),
        objects=(item,),
        track_ids=track_ids,
    )
    estimate = FlowEstimate(
        np.zeros((NUM_POINTS, 3), np.float32),
        np.ones(NUM_POINTS, bool),
        over_ground=known,
        reason_of=lambda rows: Reason(Verdict.REFUSED, len(rows), sweeps=(NEXT,)),
    )
    return SweepTriplet(*sweeps), replace(estimate, **changes)


def test_terms_of_an_object_and_of_a_place(asking):
    asking.listen()
    asking.explanations.keep(*estimated(10))
    asking.explanations.keep(*estimated(20))
    stamp_s, status = asking.ask(501.0, -1.0)
    terms = {item.key: item.value for item in status.values}
    assert (stamp_s, status.level) == (20, DiagnosticStatus.OK)
    assert terms["Called dynamic"] == "40 of 40 points"
    static = "if static 0.250 m (hit 0%, passed through 75%, hidden 25%)"
    assert terms["Sweep at +0.1 s"] == static
    assert status.message == terms["Reason"] == "refused by the gate, but goes along with object 5"
    x, y, _ = surfaces(0, NUM_POINTS)[100].tolist()
    stamp_s, status = asking.ask(x, y, stamp_s=10, frame_id="lidar")
    assert (stamp_s, len(status.values)) == (10, 5)


def test_object_that_goes_along_names_the_other_one(asking):
    leader = Leader(np.array([8.1, -2.0, 0.0]), 0.98)
    reason = {"reason_of": lambda _: Reason(Verdict.DYNAMIC, leader=leader)}
    asking.listen()
    asking.explanations.keep(*estimated(10, **reason))
    _, status = asking.ask(501.0, -1.0)
    assert status.message == (
        "goes along with what touches it at (8.1, -2.0) m and is dynamic with probability 0.98; "
        "both are object 5"
    )


def test_questions_without_an_answer(asking):
    asking.explanations.keep(*estimated(10))  # nobody listened yet
    asking.listen()
    refused = [asking.ask(0.0, 0.0)]
    asking.explanations.keep(*estimated(20))
    refused += [asking.ask(np.nan, 1e300), asking.ask(0.0, 0.0, frame_id="map")]
    asking.explanations.keep(*estimated(30, reason_of=None))
    refused.append(asking.ask(501.0, 0.0))
    assert all(status.level == DiagnosticStatus.WARN for _, status in refused)
    assert [status.message.partition(" (")[0] for _, status in refused] == [
        "no sweep was estimated since this topic has a subscriber",
        "no point within 2 m of",
        "the place is in 'map', expected 'lidar'",
        "this method gives no reasons; online does",
    ]
