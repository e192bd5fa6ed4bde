# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps that do not continue the stream: counted, logged, and the flow goes on."""

from __future__ import annotations

import itertools

import pytest
from scene_flow_peer import stamp_of


@pytest.fixture
def under_way(peer, drive):
    """A drive of which three sweeps are through; the events that it starts with do not count."""
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
    return drive


@pytest.mark.parametrize(
    ("event", "odd_index", "next_index"),
    [
        ("duplicate", 2, 3),
        ("out_of_order", 1.5, 3),
        ("gap", 12, 13),
        ("time_went_back", -20, -19),
    ],
)
def test_an_odd_stamp_is_counted_and_said_once(peer, under_way, event, odd_index, next_index):
    before = peer.count(f"sweeps_{event}")
    peer.send(under_way.sweep(odd_index))
    assert peer.count(f"sweeps_{event}") == before + 1
    sweeps = under_way.sweeps(next_index, next_index + 1, next_index + 2)
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
    said = f"{event.replace('_', ' ')} (at most every 10 min, counted in /diagnostics)"
    assert peer.process.log.count(said) == 1


@pytest.mark.parametrize("odd_index", [2, 1.5])
def test_a_refused_sweep_does_not_interrupt_the_stream(peer, under_way, odd_index):
    peer.send(*3 * [under_way.sweep(odd_index)])
    newest = under_way.sweep(3)
    peer.send(newest)
    peer.flow_of(under_way.sweep(2))


def test_another_frame_starts_anew(peer, under_way):
    before = peer.count("sweeps_frame_changed")
    sweeps = [under_way.sweep(index, frame_id="other_lidar") for index in (3, 4, 5)]
    peer.send(*sweeps)
    assert peer.flow_of(sweeps[1]).header.frame_id == "other_lidar"
    assert stamp_of(sweeps[0]) not in peer.flows
    assert peer.count("sweeps_frame_changed") == before + 1
    assert peer.process.log.count("frame changed (at most") == 1


def test_a_bag_in_a_loop_gives_flow_in_each_round(peer, drive):
    sweeps = drive.sweeps(*range(8))
    before = peer.count("sweeps_time_went_back")
    for _ in range(3):
        peer.flows.clear()
        peer.send(*sweeps)
        peer.flow_of(sweeps[-2])
    assert peer.count("sweeps_time_went_back") == before + 2


def test_sweeps_without_a_stamp_take_the_time_of_their_arrival(peer, drive):
    before, sent = peer.count("clouds_without_stamp"), []
    peer.flows.clear()

    def sweeps():
        for index in itertools.count():
            sent.append(drive.sweep(index % 20, stamp_ns=0))
            yield sent[-1]

    # On a slow machine some arrive so far apart that there is a gap between them.
    peer.send_until(sweeps(), lambda: 0 in peer.flows, "the flow")
    assert peer.count("clouds_without_stamp") == before + len(sent) >= before + 3
    assert peer.process.log.count("no stamp") == 1
    peer.wait_until_settled()
    assert peer.num_open_triplets == 0
