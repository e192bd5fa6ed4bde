"""Dropped triplets are told with their number, the reason and what to do."""

from __future__ import annotations

import pytest

from mnsf_ros.online import watches
from mnsf_ros.online.online_statistics import RecentEstimate, StatisticsSnapshot
from mnsf_ros.online.watches import BusyWatch


def snapshot(flows=0, dropped=0, estimate_ms=None):
    recent = ()
    if estimate_ms is not None:
        times_ms = {"prepare": estimate_ms - 50.0, "search": 50.0}
        recent = (RecentEstimate(9.9, 0.0, times_ms, {}, {}, "warm", "cpu", "", ""),)
    counts = {"flows_out": flows, "triplets_dropped": dropped}
    arrivals_s = tuple(index / 10 for index in range(101)) if recent else ()
    return StatisticsSnapshot(counts, recent, arrivals_s)


@pytest.fixture(autouse=True)
def _load(monkeypatch):
    monkeypatch.setattr(watches.os, "getloadavg", lambda: (4.26, 1.0, 1.0))
    monkeypatch.setattr(watches.os, "cpu_count", lambda: 2)


def test_nothing_is_said_without_drops():
    watch = BusyWatch()
    assert watch.warning(snapshot(), 0.0) == ""
    assert watch.warning(snapshot(flows=60), 6.0) == ""


def test_number_reason_and_remedy():
    text = BusyWatch().warning(snapshot(18, 42, estimate_ms=170.0), 10.0)
    assert text == (
        "CPU busy: 18 of 60 flows (an estimate takes 170 ms, sweeps come every 100 ms, load 4.3 on "
        "2 cores). Close other programs, or lower crop.max_range_m."
    )


def test_times_that_are_not_known_are_left_out():
    text = BusyWatch().warning(snapshot(0, 1), 1.0)
    assert text.startswith("CPU busy: 0 of 1 flows (load 4.3 on 2 cores).")


def test_drops_are_told_once():
    watch = BusyWatch()
    assert watch.warning(snapshot(5, 5), 1.0)
    assert watch.warning(snapshot(15, 5), 2.0) == ""
    assert watch.warning(snapshot(15, 6), 3.0)


def test_numbers_are_those_of_the_last_ten_seconds():
    watch = BusyWatch()
    for second in range(30):
        text = watch.warning(snapshot(7 * second, 3 * second), float(second))
    assert text.startswith("CPU busy: 70 of 100 flows")
