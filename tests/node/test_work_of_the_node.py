# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""When the node works: for subscribers, unless it is disabled, as fast as it can, on any clock."""

import itertools
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from node_harness import stamp_of
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger


def test_reset_forgets_the_sweeps(peer, drive):
    sweeps = drive.sweeps(*range(5))
    peer.send(*sweeps[:2])
    formed = peer.count("triplets_formed")
    response = peer.call(Trigger, "reset", Trigger.Request())
    assert response.success
    assert response.message
    peer.send(sweeps[2], sweeps[3])
    assert peer.count("triplets_formed") == formed
    peer.send(sweeps[4])
    peer.flow_of(sweeps[3])
    peer.wait_until_settled()
    assert peer.values("flow")["start"] == "cold: first triplet"


def test_a_disabled_node_takes_no_cloud_and_says_so(peer, drive):
    assert peer.call(SetBool, "set_enabled", SetBool.Request(data=False)).success
    peer.spin_until(lambda: "disabled" in peer.status("flow").message, "diagnostics to say so")
    before = peer.num_clouds
    for sweep in drive.sweeps(*range(5)):
        peer.publish(sweep)
    peer.wait_for_diagnostics()
    assert peer.num_clouds == before
    for part in ("input", "flow", "ego motion"):
        assert peer.status(part).level == DiagnosticStatus.OK
        assert "set_enabled" in peer.status(part).message
    assert peer.call(SetBool, "set_enabled", SetBool.Request(data=True)).success
    peer.spin_until(lambda: "disabled" not in peer.status("flow").message, "diagnostics")
    peer.flow_amid(drive.sweeps(*range(3)))


def test_the_input_is_checked_after_some_sweeps_and_anew_after_a_reset(peer, drive):
    def waits():
        return peer.status("input check").message == "waiting for more sweeps"

    peer.send_until(map(drive.sweep, itertools.count()), lambda: not waits(), "its result")
    peer.call(Trigger, "reset", Trigger.Request())
    peer.spin_until(waits, "diagnostics to wait")


def test_requests_without_end_do_not_fill_the_log(peer):
    start_s, before = time.monotonic(), len(peer.process.log.splitlines())
    for number in range(100):
        peer.call(SetBool, "set_enabled", SetBool.Request(data=number % 4 > 1))
        peer.call(Trigger, "reset", Trigger.Request())
    num_lines = len(peer.process.log.splitlines()) - before
    # Two kinds of lines, each at most once a second.
    assert num_lines <= 2 * (time.monotonic() - start_s + 1)


class TestWithoutSubscribers:
    def send_until_it_rests(self, peer, drive):
        """Goes on with the drive until the node knows that nobody subscribes."""
        before = peer.count("triplets_unwatched")
        sweeps = map(drive.sweep, itertools.count(100))
        peer.send_until(sweeps, lambda: peer.count("triplets_unwatched") > before, "rest")
        peer.wait_until_settled()

    def test_nothing_is_estimated(self, resting_peer, drive):
        peer = resting_peer
        self.send_until_it_rests(peer, drive)
        before, flows_out = peer.count("triplets_unwatched"), peer.count("flows_out")
        peer.send(*drive.sweeps(*range(5)))
        assert peer.count("triplets_unwatched") == before + 3
        assert peer.count("flows_out") == flows_out
        assert peer.values("flow")["busy"] == "False"
        # The diagnostics after one of the sweeps say so; not each of them is received.
        said = "resting: nobody subscribes to the flow"
        sweeps = map(drive.sweep, itertools.count(5))
        peer.send_until(sweeps, lambda: peer.status("flow").message == said, "the reason")

    def test_work_begins_with_a_subscriber_and_ends_with_it(self, resting_peer, drive):
        resting_peer.watch()
        sweeps = map(drive.sweep, itertools.count(50))
        resting_peer.send_until(sweeps, lambda: resting_peer.flows, "the first flow")
        resting_peer.stop_watching()
        self.send_until_it_rests(resting_peer, drive)

    def test_who_listens_for_explanations_is_a_subscriber(self, resting_peer, drive):
        flows_out = resting_peer.count("flows_out")
        topic = "/resting/explanation"
        listener = resting_peer.node.create_subscription(DiagnosticArray, topic, id, 10)
        sweeps = map(drive.sweep, itertools.count(75))
        resting_peer.send_until(
            sweeps, lambda: resting_peer.count("flows_out") > flows_out, "an estimate"
        )
        resting_peer.node.destroy_subscription(listener)
        self.send_until_it_rests(resting_peer, drive)

    def test_it_works_on_with_always_estimate(self, resting_peer, drive):
        peer = resting_peer
        assert peer.set({"node.always_estimate": True})[0].successful
        flows_out = peer.count("flows_out")
        peer.send(*drive.sweeps(*range(3)))
        peer.spin_until(lambda: peer.count("flows_out") > flows_out, "an estimate")
        assert peer.set({"node.always_estimate": False})[0].successful
        peer.wait_until_settled()
        unwatched = peer.count("triplets_unwatched")
        peer.send(drive.sweep(3))
        assert peer.count("triplets_unwatched") == unwatched + 1


class TestOnSimulatedTime:
    @pytest.fixture(autouse=True)
    def sim_time(self, peer):
        """The node runs on simulated time for a test."""
        assert peer.set({"use_sim_time": True})[0].successful
        yield
        assert peer.set({"use_sim_time": False})[0].successful

    @pytest.fixture
    def set_clock(self, peer):
        """Publishes the simulated time until the node has it."""
        publisher = peer.node.create_publisher(Clock, "/clock", 1)

        def set_to(stamp_ns):
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp_ns, 10**9)

            def has_arrived():
                publisher.publish(message)
                return stamp_of(peer.diagnostics[-1]["message"]) == stamp_ns

            peer.spin_until(has_arrived, f"the time {stamp_ns}")

        yield set_to
        peer.node.destroy_publisher(publisher)

    def test_there_is_flow_before_the_first_clock(self, peer, drive):
        peer.wait_for_diagnostics()
        peer.flow_amid(drive.sweeps(0, 1, 2))
        assert peer.status("input").level == b"\x00"
        before = peer.count("sweeps_duplicate")
        peer.send(*drive.sweeps(0, 1, 2, stamp_ns=0))
        assert peer.count("sweeps_duplicate") == before + 2

    def test_there_is_flow_after_a_clock_has_jumped_back(self, peer, drive, set_clock):
        sweeps = drive.sweeps(0, 1, 2)
        for sweep in sweeps:
            set_clock(stamp_of(sweep))
            peer.send(sweep)
        peer.flow_of(sweeps[1])
        set_clock(10**9)
        peer.flow_amid(drive.sweeps(3, 4, 5))

    def test_a_time_that_is_none_is_one_line_of_the_log(self, peer):
        publisher = peer.node.create_publisher(Clock, "/clock", 1)
        message, before = Clock(), peer.count("callback_errors")
        message.clock.sec = -5

        def is_counted():
            publisher.publish(message)
            return peer.count("callback_errors") > before

        peer.spin_until(is_counted, "the error")
        peer.node.destroy_publisher(publisher)
        lines = [line for line in peer.process.log.splitlines() if "clock_callback" in line]
        assert "ValueError: Seconds value must not be negative" in lines[0]
        assert len(lines) == 1

    def test_sweeps_without_a_stamp_take_the_time_of_the_clock(self, peer, drive, set_clock):
        before = peer.count("clouds_without_stamp")
        peer.flows.clear()
        for index in range(3):
            set_clock(drive.stamp_ns(index))
            peer.send(drive.sweep(index, stamp_ns=0))
        peer.spin_until(lambda: 0 in peer.flows, "the flow")
        assert peer.count("clouds_without_stamp") == before + 3
        assert peer.process.log.count("no stamp") == 1
