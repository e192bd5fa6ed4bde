"""Nothing is estimated while nobody wants it."""

from __future__ import annotations

import itertools


def send_until(peer, drive, condition, what):
    """Goes on with the drive, as a lidar does, until the condition is true."""
    indices = itertools.count(100)

    def is_true_after_a_sweep():
        peer.send(drive.sweep(next(indices)))
        return condition()

    peer.spin_until(is_true_after_a_sweep, what)


def test_without_a_subscriber_nothing_is_estimated(resting_peer, drive):
    start = len(resting_peer.diagnostics)
    before, flows_out = resting_peer.count("triplets_unwatched"), resting_peer.count("flows_out")
    resting_peer.send(*drive.sweeps(*range(5)))
    assert resting_peer.count("triplets_unwatched") == before + 3
    assert resting_peer.count("flows_out") == flows_out
    assert resting_peer.values("flow")["busy"] == "False"
    messages = {item["flow"].message for item in resting_peer.diagnostics[start:]}
    assert "resting: nobody subscribes to the flow" in messages


def test_work_begins_with_a_subscriber_and_ends_with_it(resting_peer, drive):
    resting_peer.watch()
    send_until(resting_peer, drive, lambda: resting_peer.flows, "the first flow")
    resting_peer.stop_watching()
    before = resting_peer.count("triplets_unwatched")
    send_until(
        resting_peer, drive, lambda: resting_peer.count("triplets_unwatched") > before, "rest"
    )
    resting_peer.wait_until_settled()
    flows_out = resting_peer.count("flows_out")
    resting_peer.send(*drive.sweeps(*range(5)))
    assert resting_peer.count("flows_out") == flows_out


def test_with_always_estimate_no_subscriber_is_needed(resting_peer, drive):
    assert resting_peer.set({"node.always_estimate": True})[0].successful
    flows_out = resting_peer.count("flows_out")
    resting_peer.send(*drive.sweeps(*range(3)))
    resting_peer.spin_until(lambda: resting_peer.count("flows_out") > flows_out, "an estimate")
    assert resting_peer.set({"node.always_estimate": False})[0].successful
    resting_peer.wait_until_settled()
    unwatched = resting_peer.count("triplets_unwatched")
    resting_peer.send(drive.sweep(3))
    assert resting_peer.count("triplets_unwatched") == unwatched + 1
