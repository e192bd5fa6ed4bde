"""Clouds in and no flow out is told, with the reason; everything else is not."""

from __future__ import annotations

from collections import Counter

import pytest

from mnsf_ros.online.watches import FlowWatch

PATIENCE_S = 2.0
PERIOD_S = 0.5


class Node:
    """Counters that grow, looked at in a regular period."""

    def __init__(self):
        self._watch = FlowWatch()
        self._counts = Counter()
        self._now_s = 100.0

    def goes_on(self, duration_s, *events):
        """What was said of a time in which these events happened once a period."""
        said = []
        for _ in range(round(duration_s / PERIOD_S)):
            self._now_s += PERIOD_S
            self._counts.update(events)
            said.append(self._watch.complaint(dict(self._counts), self._now_s, PATIENCE_S))
        return said


@pytest.fixture
def node():
    return Node()


@pytest.mark.parametrize(
    ("events", "words"),
    [
        (("sweeps_received", "sweeps_frame_changed"), "frame_id changes"),
        (("sweeps_received", "sweeps_duplicate"), "the same stamp"),
        (("sweeps_received", "sweeps_out_of_order"), "go backwards"),
        (("sweeps_received", "sweeps_time_went_back"), "jump back"),
        (("sweeps_received", "sweeps_gap"), "buffer.max_interval_s"),
        (("clouds_undecodable",), "cannot be decoded"),
        (("clouds_empty",), "no finite point"),
        (("sweeps_received", "triplets_formed", "estimates_failed"), "every estimate fails"),
        (("sweeps_received", "triplets_formed", "triplets_dropped"), "takes too long"),
    ],
)
def test_the_reason_names_the_counter(node, events, words):
    said = node.goes_on(PATIENCE_S + 2 * PERIOD_S, *events)
    assert said[:-1] == len(said[:-1]) * [""]
    assert words in said[-1]
    assert f"(see {events[-1]})" in said[-1]


def test_sweeps_without_any_sign_are_told(node):
    assert node.goes_on(10, "sweeps_received")[-1] == "clouds come in, but no flow goes out"


def test_the_most_frequent_reason_is_told(node):
    node.goes_on(1, "sweeps_received", "sweeps_gap")
    said = node.goes_on(10, "sweeps_received", "sweeps_duplicate")
    assert "sweeps_duplicate" in said[-1]


def test_what_happened_before_is_no_reason(node):
    node.goes_on(60, "sweeps_received", "sweeps_gap", "flows_out")
    said = node.goes_on(10, "sweeps_received", "sweeps_duplicate")
    assert "sweeps_duplicate" in said[-1]


@pytest.mark.parametrize("well", ["flows_out", "triplets_unwatched"])
def test_all_is_well_while_flow_comes_or_nobody_watches(node, well):
    assert set(node.goes_on(60, "sweeps_received", "triplets_formed", well)) == {""}


def test_flow_that_comes_back_ends_it(node):
    assert node.goes_on(10, "sweeps_received", "sweeps_gap")[-1]
    assert set(node.goes_on(10, "sweeps_received", "flows_out")) == {""}


def test_a_lidar_that_is_silent_is_no_fault_of_the_flow(node):
    node.goes_on(1, "sweeps_received", "flows_out")
    assert set(node.goes_on(60)) == {""}
    # Nor are the first sweeps after it.
    assert set(node.goes_on(1, "sweeps_received")) == {""}
    assert set(node.goes_on(60, "sweeps_received", "flows_out")) == {""}


def test_a_lidar_that_has_stopped_after_a_fault_is_forgotten(node):
    assert node.goes_on(10, "sweeps_received", "sweeps_gap")[-1]
    assert node.goes_on(PATIENCE_S + PERIOD_S)[-1] == ""
