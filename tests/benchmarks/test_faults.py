# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The benchmark of faults: what counts as told, and its table."""

import pytest

NAMES = {
    "the last cloud again and again": "ego motion: clouds repeat",
    "jump in yaw of 90 degrees": "ego motion: no motion of the sensor explains",
    "IMU stops": "turn rates of the IMU ended",
}


@pytest.fixture(scope="module")
def faults(load):
    pytest.importorskip("rclpy")
    return load("faults")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_fault_is_told_after_it_began(faults, name):
    told = faults.told_by_stream(faults.FAULTS[name], seed=0)
    assert told.text.startswith(NAMES[name])
    assert told.after_s <= 0.5


@pytest.mark.slow
def test_nothing_is_told_without_a_fault(faults):
    nothing = faults.Fault(lambda sweeps, number: sweeps[number])
    assert faults.told_by_stream(nothing, seed=0) == faults.Told()


def test_the_table_says_what_is_not_told(faults):
    found = {"a": faults.Told("x" * 200, 0.3), "b": faults.Told()}
    first, second = faults.fault_table("Faults", found).rows
    assert first == ["a", f"{'x' * 90} ...", "0.3", "yes"]
    assert second == ["b", "-", "", "NO"]
