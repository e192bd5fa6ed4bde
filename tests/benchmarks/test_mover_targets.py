# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script of `make benchmark-movers`: what is scored, and how it is judged."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.mover_summary import FAST
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow
from mnsf_ros.evaluation.results import ResultRow, summarize


@pytest.fixture
def movers(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module("movers")


def summary(*found, num_dynamic=10, points=(95, 5, 0), num_ghosts=0):
    """A mover of 5 m/s, found or not in sweeps a tenth of a second apart."""
    errors = {
        "dynamic": FlowErrors(0.03, 1, 1, 0, 0, num_dynamic),
        "static": FlowErrors(0.01, 1, 1, 0, 0, 10),
    }
    rows = [
        ResultRow(
            *("drive", number, number * 10**8, "KITTI 0005", 10),
            errors=errors,
            movers=MoverRow(
                points,
                num_ghosts,
                objects=[ObjectRow(1, "car", True, 5.0, 10.0, 50, float(is_found), 0.3)],
            ),
        )
        for number, is_found in enumerate(found)
    ]
    (one,) = summarize(rows)
    return one


def test_targets_are_met_or_missed(movers):
    judged = {target.text: target for target in movers.targets(summary(*[True] * 9, False, True))}
    found = judged[f"found, {FAST.name} (% of sweeps)"]
    assert (found.limit, found.measured, found.is_met) == (97, 87.5, False)
    lost = judged[f"lost and found again, {FAST.name} (% of sweeps)"]
    assert (lost.limit, round(lost.measured, 1), lost.is_met) == (1, 9.1, False)
    assert judged["called dynamic and are (%)"].is_met
    assert judged["dynamic EPE (m)"].is_met
    assert not judged["velocity error (m/s)"].is_met
    assert math.isnan(judged["called a mover after a stop (s)"].measured)


def test_standing_scene_is_judged_by_false_movers(movers):
    standing = summary(True, num_dynamic=0, num_ghosts=1)
    judged = {target.text: target for target in movers.targets(standing)}
    assert "called dynamic and are (%)" not in judged
    ghosts = judged["standing: sweeps with a false mover (%)"]
    assert (ghosts.measured, ghosts.is_met) == (100, False)


def test_table_has_a_row_for_each_group_and_nothing_of_what_cannot_be_judged(movers):
    *_, table = movers.tables("reported", [summary(*[True] * 6)])
    cells = dict(zip(table.header, table.rows[0], strict=True))
    assert cells[""] == "KITTI 0005"
    assert cells[f"found, {FAST.name} (% of sweeps), at least 97"] == "100 met"
    assert cells["velocity error (m/s), at most 0.2"] == "0.3 MISSED"
    assert not any("stop" in title for title in table.header)
    assert table.title == "Targets, reported half: 4 of 5 met"


def test_rows_of_simulated_sweeps_have_objects(movers):
    recordings = importlib.import_module("online_recordings")
    sweeps = recordings.simulated_sweeps(0, 5, num_beams=16, num_columns=300)
    times_ms = []
    rows = list(movers.scored("street", "street 0", sweeps, range(1, 4), times_ms))
    assert [row.number for row in rows] == [1, 2, 3]
    assert len(times_ms) == 3
    assert all(row.errors["static"].num_points > 0 for row in rows)
    assert {item.kind for row in rows for item in row.movers.objects} - {"unknown"}
    assert all(np.isfinite(row.errors["static"].epe_m) for row in rows)
