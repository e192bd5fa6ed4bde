# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings as parameters: described, checked, changed while the node runs."""

import math
import re

import pytest
from rcl_interfaces.msg import ParameterType, ParameterValue

from mnsf_ros.settings import Settings, declared_setting, declared_settings

# The iterations of networks, which this node does not have, and a setting whose use shows.
ITERATIONS, LAYOUT = "optimization.max_iterations", "output.layout"
NOTHING = ParameterValue(type=ParameterType.PARAMETER_NOT_SET)


@pytest.fixture(autouse=True)
def same_settings_afterwards(peer):
    """Each test finds the settings that the node was started with."""
    names = ("crop.min_range_m", "crop.max_range_m", ITERATIONS, LAYOUT)
    before = {name: peer.get(name) for name in names}
    yield
    assert peer.set_atomically(before).successful


def layout_of_a_drive(peer, drive):
    """The layout of the flow of a few sweeps."""
    names = [field.name for field in peer.flow_amid(drive.sweeps(0, 1, 2)).fields]
    return "full" if "confidence" in names else "compact"


def test_every_setting_is_a_parameter_with_its_description_and_range(peer):
    assert {setting.name for setting in declared_settings()} <= peer.parameter_names()
    described = peer.describe("crop.max_range_m")
    assert described.description == f"{declared_setting('crop.max_range_m').text} [m]"
    (range_m,) = described.floating_point_range
    assert (range_m.from_value, range_m.to_value) == (1.0, 1000.0)
    (layers,) = peer.describe("field.num_hidden_layers").integer_range
    assert (layers.from_value, layers.to_value) == (1, 32)
    kinds = peer.describe("distance.kind").additional_constraints
    assert kinds == "one of grid, bricks, cells, tree"
    assert peer.describe("method.name").read_only is True
    assert peer.describe("crop.max_range_m").read_only is False
    for name in ("distance.kind", "objects.thinning_m", "warm_start.enabled", "compute.seed"):
        assert peer.get(name) == Settings().value_of(name)


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [("crop.max_range_m", 60, float), (ITERATIONS, 12.0, int)],
)
def test_a_parameter_keeps_its_type(peer, name, value, kind):
    for change in (peer.set, lambda changes: [peer.set_atomically(changes)]):
        assert all(result.successful for result in change({name: value}))
        assert peer.get(name) == value
        assert type(peer.get(name)) is kind


def test_a_change_applies_from_the_next_triplet_on(peer, drive):
    (result,) = peer.set({LAYOUT: "compact"})
    assert result.successful
    assert peer.get(LAYOUT) == "compact"
    assert layout_of_a_drive(peer, drive) == "compact"


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("crop.max_range_m", 5000, r"crop\.max_range_m: got 5000, expected a number from 1 to"),
        ("crop.max_range_m", math.nan, r"crop\.max_range_m out of range"),
        ("crop.max_range_m", "far", r"crop\.max_range_m: got 'far', expected a number"),
        ("crop.min_range_m", 90.0, r"got 90\.0, expected less than crop\.max_range_m, which is 80"),
        (ITERATIONS, 2.5, r"got 2\.5, expected a whole number"),
        ("distance.kind", "octree", r"^distance\.kind: got 'octree', expected one of grid, bri"),
        ("warm_start.enabled", 1, r"warm_start\.enabled: got 1, expected true or false"),
        ("distance.kind", NOTHING, r"^distance\.kind: got None"),
        ("crop.max_range_m", "é\n" * 1000, r"^crop\.max_range_m: got 'é"),
        (ITERATIONS, [80.0], r"^optimization\.max_iterations: got "),
        ("method.name", "mnsf", r"read-only parameter: method\.name"),
        ("crop.max_range", 5.0, r"^unknown parameter 'crop\.max_range'; did you mean crop\.max_ra"),
        pytest.param("x" * 10_000, 5.0, r"^unknown parameter 'x+\.\.\.x+'$", id="long name"),
    ],
)
def test_an_invalid_value_is_refused_with_the_reason(peer, name, value, reason):
    before = peer.get(name) if name in peer.parameter_names() else None
    for result in (*peer.set({name: value}), peer.set_atomically({name: value})):
        assert not result.successful
        assert re.search(reason, result.reason), result.reason
    if before is not None:
        assert peer.get(name) == before


class TestSeveralAtOnce:
    @pytest.mark.parametrize("other", ["crop.max_range_m", "no.such"])
    def test_are_refused_together_if_one_is_wrong(self, peer, drive, other):
        result = peer.set_atomically({LAYOUT: "compact", other: "x"})
        assert not result.successful
        assert other in result.reason
        assert peer.get(LAYOUT) == "full"
        assert layout_of_a_drive(peer, drive) == "full"

    def test_may_be_right_only_together(self, peer):
        assert not peer.set({"crop.min_range_m": 100.0})[0].successful
        assert peer.set_atomically(
            {"crop.min_range_m": 100.0, "crop.max_range_m": 200.0}
        ).successful
        assert not peer.set({"crop.max_range_m": 80.0})[0].successful


def test_a_value_of_a_type_that_does_not_exist_does_not_end_the_node(peer, drive):
    """rclpy raises out of its own parameter service; the node says so in one line."""
    before = peer.count("callback_errors")
    peer.set_without_waiting({"crop.max_range_m": ParameterValue(type=255)})
    peer.spin_until(lambda: peer.count("callback_errors") > before, "the error to be counted")
    assert "refused by ROS in " in peer.process.log
    assert peer.set({LAYOUT: "compact"})[0].successful
    assert layout_of_a_drive(peer, drive) == "compact"
