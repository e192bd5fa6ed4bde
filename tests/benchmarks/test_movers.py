# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`make benchmark-movers`: figures of random worlds, of a world, and targets."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest


@pytest.fixture(scope="module")
def score(load):
    """A world with 16 beams and a lorry that is found."""
    return load("world_scores").world_score(load("drives").random_world(22, 8))


def test_a_world_is_scored(score):
    assert score.lidar == "16 beams"
    assert 0 < score.figures["recall"] < 1
    assert 0 < score.figures["static EPE"] < score.figures["dynamic EPE"]
    assert {is_scratch for _, is_scratch in score.confidence} == {False, True}
    assert 0 < score.figures["ego motion"] < 0.02


def test_recall_counts_where_precision_is_high_enough(load):
    recall = load("world_scores")._recall
    sure, unsure = np.float32([0.9] * 95 + [0.5] * 20), [True] * 95 + [False] * 20
    assert recall([(sure, np.array(unsure), 190)]) == 0.5
    # Points of the same confidence are called together: 95 right ones and 20 wrong ones.
    assert recall([(np.full(115, np.float32(0.9)), np.array(unsure), 190)]) == 0.0
    assert math.isnan(recall([(sure[:0], np.array([], bool), 0)]))


def drive(called, speeds_m_s):
    """A car, sweep by sweep."""
    number = len(called)
    columns = {"object_id": [1] * number, "class_id": [6.0] * number, "speed_m_s": speeds_m_s}
    return pd.DataFrame({**columns, "is_called": called, "time_s": 0.1 * np.arange(number)})


@pytest.mark.parametrize(
    ("called", "held", "released"),
    [
        ([True] * 8 + [False] * 8, [True], [True]),
        ([True] * 6 + [False] * 10, [False], [True]),
        ([True] * 16, [True], [False]),
        # What was never found moving is missed, and counted as such.
        ([False] * 16, [], []),
    ],
)
def test_a_braking_vehicle_is_called_a_mover_until_it_stands(load, called, held, released):
    speeds_m_s = np.maximum(4.0 - 0.5 * np.arange(16), 0.0)
    assert load("world_scores")._braking(drive(called, speeds_m_s)) == (held, released)


def test_worlds_are_summed_up_for_each_lidar(load, score):
    movers = load("movers")
    worse = replace(score, seed=7, figures=score.figures | {"recall": 0.1, "false movers": 2.0})
    other = replace(score, seed=8, lidar="64 beams")
    still = replace(
        score, seed=9, scenario="standing", figures=score.figures | {"recall": math.nan}
    )
    scores = [score, worse, other, still]
    table, errors, kinds, targets = movers.world_tables(scores)
    assert sum(int(row[1]) for row in kinds.rows) >= 3 * len(kinds.rows) > 0
    assert [row[0] for row in errors.rows] == [row[0] for row in table.rows]
    assert [row[:2] for row in table.rows] == [
        ["16 beams", "2"],
        ["64 beams", "1"],
        ["all", "3"],
        ["standing", "1"],
    ]
    names = [row[0] for row in targets.rows]
    assert "16 beams: recall at .95 precision, worst tenth" in names
    assert "64 beams: pedestrians to 30 m, median" in names
    assert names[-1] == "standing: false movers a sweep, worst tenth"
    assert movers.figures(scores).loc[7, "recall"] == 0.1


def test_methods_are_compared_on_the_same_worlds(load, score):
    """Each further method has rows of its own; the first one alone is judged for each lidar."""
    movers = load("movers")
    assert score.method == "online"
    worse = [
        replace(
            score,
            seed=seed,
            method="mnsf",
            figures=score.figures | {"dynamic EPE": factor * score.figures["dynamic EPE"]},
            errors_m={kind: [2 * m for m in own] for kind, own in score.errors_m.items()},
        )
        for seed, factor in ((22, 1.5), (23, 1.2), (24, 0.9))
    ]
    scores = [*(replace(score, seed=one.seed) for one in worse), *worse]
    table, _, kinds, ratios, targets = movers.world_tables(scores)
    assert [row[:2] for row in table.rows] == [
        ["16 beams", "3"],
        ["all", "3"],
        ["all, `mnsf`", "3"],
    ]
    (row,) = ratios.rows
    assert row[2:] == ["1.20, better in 1 of 3 worlds", "met"]
    assert not any("mnsf" in row[0] for row in targets.rows)
    # Both cells are rounded to millimetres.
    assert all(float(row[3]) == pytest.approx(2 * float(row[2]), abs=2e-3) for row in kinds.rows)


def test_the_worst_tenth_is_at_the_bad_end(load, score):
    movers = load("movers")
    for figure, worst in (("recall", 0.1), ("false movers", 0.9)):
        scores = [
            replace(score, figures={figure: share}) for share in (*np.linspace(0, 1, 11), math.nan)
        ]
        assert movers.spread(scores, figure) == pytest.approx((0.5, worst))


def test_a_kept_world_is_the_same_world(load, tmp_path):
    drives = load("drives")
    made, kept = (drives.kept_world(18, 0.2, "random", tmp_path / "cache") for _ in range(2))
    assert len(made.sweeps) == len(kept.sweeps) == 4
    assert np.array_equal(made.sweeps[3].truth.flow, kept.sweeps[3].truth.flow)
    assert len(list((tmp_path / "cache").iterdir())) == 1
    assert drives.kept_world(18, 0.2, "standing", tmp_path / "cache").text != made.text


def test_what_moved_lately_is_no_false_mover(load):
    """A car that has just stopped may still be called a mover for half a second."""
    drives, scores = load("drives"), load("world_scores")
    sweeps = drives.random_world(22, 9).sweeps
    truth = sweeps[2].truth
    car = np.unique(truth.object_id[truth.dynamic])[0]

    def without_car(truth):
        return replace(truth, dynamic=truth.dynamic & (truth.object_id != car))

    stopped = [replace(one, truth=without_car(one.truth)) for one in sweeps]
    stopped[:3] = sweeps[:3]
    moved = [car in scores._moved_lately(stopped, index) for index in (2, 3, 7, 8)]
    assert moved == [True, True, True, False]
