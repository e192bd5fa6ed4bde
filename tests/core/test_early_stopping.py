# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The rule of early stopping, on losses made up by hand; all of them exact in binary."""

from __future__ import annotations

import math

import pytest

from mnsf_ros.core.optimization import EarlyStopping


def stops_at(losses, patience, min_delta_m=0.0):
    """Number of the loss, from 1, at which the rule says stop; None if it never does."""
    rule = EarlyStopping(patience, min_delta_m)
    for number, loss in enumerate(losses, start=1):
        if rule.should_stop(loss):
            return number
    return None


def test_falling_loss_never_stops():
    assert stops_at([8, 7, 6, 5, 4, 3, 2, 1], patience=1) is None


@pytest.mark.parametrize("patience", [1, 2, 5])
def test_constant_loss_stops_when_patience_is_at_its_end(patience):
    # The first loss is better than nothing, each one after it is no improvement.
    assert stops_at([1] * 20, patience) == 1 + patience


def test_rising_loss_is_no_improvement():
    assert stops_at([1, 2, 3, 4, 5], patience=3) == 4


def test_improvement_restores_patience():
    assert stops_at([4, 4, 4, 3, 3, 3, 3, 3], patience=3) == 7


@pytest.mark.parametrize(("loss", "stop"), [(0.75, 3), (0.74, 4)])
def test_fall_by_min_delta_itself_is_no_improvement(loss, stop):
    assert stops_at([1, loss, loss, loss], patience=2, min_delta_m=0.25) == stop


def test_small_falls_add_up():
    # 0.875 is no improvement on 1, but 0.625 is, though only 0.125 below its predecessor.
    losses = [1, 0.875, 0.75, 0.625, 0.5, 0.375, 0.25]
    assert stops_at(losses, patience=3, min_delta_m=0.25) is None
    assert stops_at(losses, patience=2, min_delta_m=0.25) == 3


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_loss_that_is_not_finite_is_no_improvement(bad):
    assert stops_at([1, bad, bad], patience=2) == 3
    assert stops_at([bad, bad], patience=2) == 2


def test_patience_of_zero_turns_the_rule_off():
    assert stops_at([1] * 1000, patience=0) is None
    assert not EarlyStopping(0, 0.0).is_on
    assert EarlyStopping(1, 0.0).is_on
