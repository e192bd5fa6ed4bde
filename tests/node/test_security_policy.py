# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The policy for SROS 2 allows what the node has, and nothing else."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from mnsf_ros.settings import declared_setting

MOST_LIDARS = int(declared_setting("lidars.count").maximum)
POLICY = Path(__file__).parents[2] / "config" / "security_policy.xml"
# With several lidars, use_sim_time, tf2_ros, the packages of other planners, odometry, and with a
# life cycle.
OPTIONAL = {
    "subscribe": {
        *("/clock", "/tf", "/tf_static", "~/odometry"),
        *(f"~/points_{number}" for number in range(2, MOST_LIDARS + 1)),
    },
    "publish": {"~/objects/autoware", "~/objects/nav2", "~/transition_event", "/tf"},
    "reply": {
        *("~/change_state", "~/get_state", "~/get_available_states"),
        *("~/get_available_transitions", "~/get_transition_graph"),
    },
}


def allowed(rule):
    """Names of topics or services that a rule of the policy allows."""
    profile = ElementTree.parse(POLICY).getroot().find("./enclaves/enclave/profiles/profile")
    lists = [one for one in profile if one.get(rule) == "ALLOW"]
    return {item.text for one in lists for item in one}


@pytest.mark.parametrize(
    ("rule", "names_of"),
    [
        ("subscribe", "get_subscriber_names_and_types_by_node"),
        ("publish", "get_publisher_names_and_types_by_node"),
        ("reply", "get_service_names_and_types_by_node"),
    ],
)
def test_it_is_what_the_node_has(peer, rule, names_of):
    def found():
        names = {name for name, _ in peer.names_and_types(names_of)}
        return {name.replace("/quick/", "~/", 1) for name in names}

    peer.spin_until(lambda: allowed(rule) - OPTIONAL[rule] <= found(), "all that is allowed")
    assert found() <= allowed(rule)


def test_the_node_calls_no_service_of_others(peer):
    assert peer.names_and_types("get_client_names_and_types_by_node") == []


def test_nothing_is_allowed_by_a_pattern_or_to_others():
    names = set().union(*(allowed(rule) for rule in OPTIONAL))
    assert not [name for name in names if "*" in name]
    assert allowed("request") == set()
    assert all(OPTIONAL[rule] <= allowed(rule) for rule in OPTIONAL)
