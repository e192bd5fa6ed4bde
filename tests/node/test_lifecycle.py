# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node with a life cycle, through the services that `ros2 lifecycle` uses."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_harness import QUICK


@pytest.fixture(scope="module")
def managed(run_node):
    return ManagedPeer(run_node(QUICK, name="/managed", has_life_cycle=True))


@pytest.fixture(autouse=True)
def unconfigured(managed):
    """Each test finds the node as it was started."""
    yield
    for number in {
        State.PRIMARY_STATE_ACTIVE: (
            Transition.TRANSITION_DEACTIVATE,
            Transition.TRANSITION_CLEANUP,
        ),
        State.PRIMARY_STATE_INACTIVE: (Transition.TRANSITION_CLEANUP,),
    }.get(managed.state, ()):
        assert managed.change(number)


class ManagedPeer:
    """The requests of a lifecycle manager."""

    def __init__(self, peer):
        self.peer = peer

    @property
    def state(self):
        return self.peer.call(GetState, "get_state", GetState.Request()).current_state.id

    def change(self, number, label=""):
        request = ChangeState.Request(transition=Transition(id=number, label=label))
        return self.peer.call(ChangeState, "change_state", request).success

    def activate(self):
        assert self.change(Transition.TRANSITION_CONFIGURE)
        assert self.change(Transition.TRANSITION_ACTIVATE)
        self.peer.wait_for_node()
        self.wait_for_message("", part="input", level=None)

    def wait_for_message(self, words, part="flow", level=DiagnosticStatus.OK):
        """Until diagnostics that were made from now on have these words."""
        self.peer.wait_for_diagnostics()
        self.peer.spin_until(
            lambda: (
                words in self.peer.status(part).message
                and level in (None, self.peer.status(part).level)
            ),
            f"diagnostics with {words!r}",
        )

    def has_topic(self, name):
        return self.peer.node.count_publishers(f"/managed/{name}") > 0


def test_flow_goes_out_only_while_active(managed, drive):
    peer = managed.peer
    assert managed.state == State.PRIMARY_STATE_UNCONFIGURED
    assert not managed.has_topic("flow")
    assert managed.change(Transition.TRANSITION_CONFIGURE)
    peer.wait_for_node()
    for sweep in drive.sweeps(*range(4)):
        peer.publish(sweep)
    managed.wait_for_message("inactive")
    assert peer.num_clouds == 0
    assert managed.change(Transition.TRANSITION_ACTIVATE)
    managed.wait_for_message("waiting for sweeps")
    peer.flow_amid(drive.sweeps(*range(10, 13)))
    assert managed.change(Transition.TRANSITION_DEACTIVATE)
    managed.wait_for_message("inactive")
    before, num_flows = peer.num_clouds, len(peer.flows)
    for sweep in drive.sweeps(*range(20, 24)):
        peer.publish(sweep)
    peer.wait_for_diagnostics()
    assert (peer.num_clouds, len(peer.flows)) == (before, num_flows)


def test_cleanup_lets_go_of_all_but_the_parameters(managed, drive):
    peer = managed.peer
    peer.set({"crop.max_range_m": 33.0})
    managed.activate()
    peer.flow_amid(drive.sweeps(*range(3)))
    assert managed.change(Transition.TRANSITION_DEACTIVATE)
    assert managed.change(Transition.TRANSITION_CLEANUP)
    peer.spin_until(lambda: not managed.has_topic("flow"), "the end of the topic")
    peer.spin_until(lambda: peer.num_subscribers == 0, "the end of the subscription")
    assert peer.get("crop.max_range_m") == 33.0
    managed.activate()
    # Counters begin anew, and the estimator, too.
    assert peer.num_clouds == 0
    peer.flow_amid(drive.sweeps(*range(50, 53)))
    peer.wait_until_settled()
    assert peer.values("flow")["start"] == "cold: first triplet"
    peer.set({"crop.max_range_m": 80.0})


def test_a_transition_that_the_state_does_not_have_is_refused(managed):
    assert not managed.change(Transition.TRANSITION_ACTIVATE, "activate")
    assert not managed.change(0, "x" * 10_000)
    # Without a label, where rclpy raises.
    assert not managed.change(77)
    assert managed.state == State.PRIMARY_STATE_UNCONFIGURED
    assert managed.change(Transition.TRANSITION_CONFIGURE)
    assert not managed.change(Transition.TRANSITION_CONFIGURE, "configure")
    assert managed.state == State.PRIMARY_STATE_INACTIVE
    log = managed.peer.process.log
    assert log.count("refused by ROS in ") == 1
    assert max(map(len, log.splitlines())) < 1000


def test_invalid_settings_fail_the_configuration(managed):
    assert all(result.successful for result in managed.peer.set({"method.name": "nonsense"}))
    assert not managed.change(Transition.TRANSITION_CONFIGURE)
    assert managed.state == State.PRIMARY_STATE_UNCONFIGURED
    assert "cannot configure" in managed.peer.process.log
    managed.peer.spin_until(lambda: not managed.has_topic("flow"), "no topic")
    managed.peer.set({"method.name": "zero"})
    assert managed.change(Transition.TRANSITION_CONFIGURE)
    managed.wait_for_message("inactive")
    assert managed.peer.values("flow")["method"] == "zero"
    (refused,) = managed.peer.set({"method.name": "online"})
    assert (refused.successful, refused.reason) == (
        False,
        "method.name is fixed until the node is cleaned up",
    )
    assert managed.change(Transition.TRANSITION_CLEANUP)
    assert managed.peer.set({"method.name": "online"})[0].successful


def test_shutdown_is_the_end(run_node):
    managed = ManagedPeer(run_node(QUICK, name="/ended", has_life_cycle=True))
    assert managed.change(Transition.TRANSITION_CONFIGURE)
    assert managed.change(Transition.TRANSITION_INACTIVE_SHUTDOWN)
    assert managed.state == State.PRIMARY_STATE_FINALIZED
    assert not managed.change(Transition.TRANSITION_CONFIGURE, "configure")
