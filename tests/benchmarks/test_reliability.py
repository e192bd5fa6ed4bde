# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script that measures promises: rounds, verdicts, growth."""

import sys
from collections import Counter

import pytest

pytest.importorskip("rclpy")


@pytest.fixture
def reliability(load):
    return load("reliability")


def drawn(rounds):
    return {number: random.random() for number, random in rounds}


def test_rounds_in_pieces_are_those_of_one_long_run(reliability):
    rounds = reliability.Rounds
    whole = drawn(rounds(5))
    assert list(whole) == [0, 1, 2, 3, 4]
    assert drawn(rounds(2)) | drawn(rounds(3, first=2)) == whole


@pytest.mark.parametrize(
    ("fate", "number", "status", "verdict"),
    [("same", 1, 0, "in part"), ("same", 2, 0, "met"), ("wrong: other", 2, 1, "MISSED")],
)
def test_a_promise_is_met_in_part_or_missed(
    reliability, monkeypatch, capsys, fate, number, status, verdict
):
    def measure(rounds):
        """It holds."""
        yield reliability.fates("runs", Counter(fate for _ in rounds))

    promise = reliability.Promise(2, "rounds", measure)
    monkeypatch.setattr(reliability, "PROMISES", {"it": promise})
    monkeypatch.setattr(reliability.signal, "signal", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["reliability.py", "it", "--number", str(number)])
    with pytest.raises(SystemExit) as ended:
        reliability.main()
    assert ended.value.code == status
    row = f"| `it` | It holds | {number} of 2 rounds | {verdict} |"
    assert capsys.readouterr().out.splitlines()[-1] == row


@pytest.mark.parametrize(("grown_mb", "is_met"), [(0, True), (15, True), (30, False)])
def test_growing_memory_is_told_from_swinging_memory(reliability, grown_mb, is_met):
    held = {"descriptors": 23, "threads": 18, "segments": 9}
    states = [
        {"MB": 400 + grown_mb * index / 359 + 30 * (index % 6 == 5), **held} for index in range(360)
    ]
    assert [met for _, _, met in reliability.growth(states)] == [is_met, True, True, True]
    states[-1]["threads"] += 1
    assert [met for _, _, met in reliability.growth(states)] == [is_met, True, False, True]
