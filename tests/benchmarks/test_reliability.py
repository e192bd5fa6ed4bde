# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script that measures promises: its rounds, its verdicts, and the rows that it writes."""

from __future__ import annotations

import importlib
import itertools
import sys
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

ROOT = Path(__file__).parents[2]


@pytest.fixture
def benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module


@pytest.fixture
def promises(benchmarks):
    return benchmarks("promises")


@pytest.fixture
def reliability(benchmarks):
    return benchmarks("reliability")


def drawn(rounds):
    return {number: random.random() for number, random in rounds}


def test_rounds_in_pieces_are_those_of_one_long_run(promises):
    whole = drawn(promises.Rounds(5, 1))
    pieces = drawn(promises.Rounds(2, 1)) | drawn(promises.Rounds(3, 1, first=2))
    assert list(whole) == [0, 1, 2, 3, 4]
    assert pieces == whole
    assert len(set(whole.values())) == 5
    assert drawn(promises.Rounds(5, 1, seed=1)).keys() == whole.keys()
    assert drawn(promises.Rounds(5, 1, seed=1)) != whole


def test_rounds_end_when_time_is_over_or_they_are_stopped(promises):
    none = promises.Rounds(5, -1)
    assert drawn(none) == {}
    rounds = promises.Rounds(5, 1)
    for number, _ in rounds:
        if number == 2:
            rounds.stop()
    assert rounds.done == 3


def test_a_wrong_fate_breaks_a_promise(promises):
    held = Counter({"as without": 1200, "with --resume": 3})
    assert promises.fates("run", held) == ("run", "as without: 1,200, with --resume: 3", True)
    assert not promises.fates("run", held + Counter({"wrong: other rows": 1}))[2]
    assert not promises.fates("all", Counter({"same": 1, "crash": 1}), ("crash", "hang"))[2]


def measured(reliability, monkeypatch, document, is_met=True, number=2, minutes=1):
    """Runs the script with one promise of two rounds; returns its status and the rows written."""

    def measure(rounds):
        yield "rounds", str(len(list(rounds))), is_met

    monkeypatch.setattr(
        reliability,
        "PROMISES",
        {name: reliability.Promise(f"`{name}` holds", 2, "rounds", measure) for name in ("a", "b")},
    )
    options = ["all", "--number", number, "--minutes", minutes, "--document", document]
    monkeypatch.setattr(sys, "argv", ["reliability.py", *map(str, options)])
    monkeypatch.setattr(reliability.signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        reliability.main()
    lines = document.read_text().splitlines()
    return ended.value.code, [line for line in lines if "holds" in line]


def test_each_promise_has_one_row_with_the_last_measurement(reliability, monkeypatch, tmp_path):
    document = tmp_path / "document.md"
    document.write_text("before\n<!-- begin reliability -->\n<!-- end reliability -->\nafter\n")
    expected = [(True, 1, 1, 0, "in part"), (True, 2, 1, 0, "met"), (False, 2, 1, 1, "MISSED")]
    for is_met, number, minutes, status, verdict in expected:
        code, rows = measured(reliability, monkeypatch, document, is_met, number, minutes)
        assert code == status
        assert len(rows) == 2
        for row in rows:
            assert row.endswith(f"| {verdict} |")
            assert f"{number} of 2 rounds in 0 min; rounds: {number}" in row
    assert document.read_text().startswith("before\n")
    assert document.read_text().endswith("after\n")


def test_time_that_a_promise_leaves_is_for_the_next_ones(reliability, promises, monkeypatch):
    minutes = []

    def rounds(number, share, *more):
        minutes.append(share)
        return promises.Rounds(number, share, *more)

    monkeypatch.setattr(reliability, "Rounds", rounds)
    monkeypatch.setattr(reliability, "_write_row", lambda *_: None)
    document = Path("unused")
    monkeypatch.setattr(Path, "read_text", lambda self: "")
    # So many that what a slow machine takes for two rounds does not matter.
    measured(reliability, monkeypatch, document, minutes=1000)
    assert minutes == [500, pytest.approx(1000, abs=10)]


def test_rows_of_the_page_are_those_of_the_script(reliability):
    text = (ROOT / "docs" / "reliability.md").read_text()
    section = text.partition("<!-- begin reliability -->")[2].partition("<!-- end")[0]
    rows = [tuple(row.strip("| ").split(" | ")[:2]) for row in section.splitlines()[3:]]
    known = [(promise.text, f"`{name}`") for name, promise in reliability.PROMISES.items()]
    assert rows == [row for row in known if row in rows]
    assert rows


def test_hostile_clouds_are_of_every_kind(benchmarks):
    clouds = benchmarks("hostile_clouds")
    live = benchmarks("reliability_live")
    sweep = benchmarks("online_recordings").simulated_sweeps(0, 1, num_beams=16, num_columns=90)
    good = bytes(live.serialized(sweep[0].sweep))
    for kind, (_, random) in itertools.product(clouds.KINDS, benchmarks("promises").Rounds(3, 1)):
        assert isinstance(clouds.hostile(kind, good, random), bytes)


@pytest.mark.parametrize(("grown_mb", "is_met"), [(0, True), (15, True), (30, False)])
def test_memory_that_grows_is_told_from_memory_that_swings(benchmarks, grown_mb, is_met):
    held = {"descriptors": 23, "threads": 18, "segments": 9}
    states = [
        {"MB": 400 + grown_mb * index / 359 + 30 * (index % 6 == 5), **held} for index in range(360)
    ]
    figures = benchmarks("reliability_live").growth(states)
    assert [met for _, _, met in figures] == [is_met, True, True, True]


def test_a_thread_more_is_growth_in_a_short_run_too(benchmarks):
    states = [
        {"MB": 400, "descriptors": 23, "threads": 18 + extra, "segments": 9} for extra in (0, 1)
    ]
    figures = {name: met for name, _, met in benchmarks("reliability_live").growth(states)}
    assert figures == {"memory": True, "descriptors": True, "threads": False, "segments": True}
