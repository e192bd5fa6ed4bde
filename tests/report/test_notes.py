# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Protocol and notes of a run."""

from dataclasses import replace

import pytest
from small_runs import METHODS, dropped, failed, recording, row, rows, run_record

from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.task import FinishedTask
from mnsf_ros.presets import preset
from mnsf_ros.report.run_results import results_of

FINISHED = [FinishedTask("street", method, 4) for method in METHODS]


def protocol(rows, record):
    return " ".join(results_of(record, rows).protocol)


def notes(rows=(), finished=FINISHED, **record):
    """Texts of the notes, those of what is incomplete and the others."""
    record = {"methods": METHODS, "recordings": [recording()], **record}
    found = results_of(run_record(**record, finished=finished), rows).notes
    parts = (
        [note.text for note in found if note.is_incomplete is is_so] for is_so in (True, False)
    )
    return tuple(parts)


def test_protocol_says_what_the_figures_are_of():
    text = protocol([row(1, "mnsf", 0.1), row(1, "zero", 0.1)], run_record())
    for part in (
        "Unweighted mean over 1 example from 1 recording.",
        "Scored: 2,048 random points within 0 to ",
        "ground left out by the truth; seed 7.",
        "Settings: mnsf: preset paper, warm start off.",
        "threads: 1",
    ):
        assert part in text
    late = row(5, "fnsf", 0.1)
    assert "over 3 to 4 examples" in protocol([*rows(), late], run_record())


def test_protocol_tells_the_settings_of_each_method():
    settings = preset("paper").changed({"objects.min_probability": 0.4})
    record = run_record(["online", "mnsf", "zero"], options=EvaluationOptions(settings))
    changed = "objects.min_probability = 0.4"
    text = protocol([row(1, name, 0.1) for name in record.method_names], record)
    assert (
        f"Settings: online: preset online with {changed}, warm start on; "
        f"mnsf: preset paper with {changed}, warm start off."
    ) in text
    text = protocol([row(1, "zero", 0.1)], record)
    assert f"Settings: zero: preset paper with {changed}, warm start off." in text


@pytest.mark.parametrize(
    ("ground", "truth", "said"),
    [
        ("truth", "/t", "by the truth"),
        ("truth", None, "by the settings"),
        ("settings", "/t", "by the settings"),
    ],
)
def test_protocol_tells_the_source_of_ground(ground, truth, said):
    record = run_record(recordings=[recording(truth=truth)])
    record = replace(record, options=replace(record.options, ground=ground))
    assert f"ground left out {said}" in protocol(rows(), record)


def test_damage_missing_truth_and_events():
    street = recording(damages=["a.mcap, byte 7: cut"], truth=None)
    task = FinishedTask("street", "mnsf", 3, {Event.GAP.value: 2}, ["b: c"])
    incomplete, others = notes([], [task, *FINISHED[1:]], recordings=[street])
    assert incomplete == ["Damage: a.mcap, byte 7: cut", "Damage: b: c"]
    assert others == [
        "street: no true flow, so no errors.",
        f"street: {Event.GAP.value}: 2.",
    ]


def test_unfinished_tasks_and_recordings_without_examples():
    finished = [FinishedTask("street", "fnsf", 0)]
    incomplete, _ = notes([row(1, "mnsf", 0.1)], finished, methods=["mnsf", "fnsf"])
    assert incomplete == [
        "Unfinished: mnsf on street, examples so far: 1; continue with --resume.",
        "No example: street contains no 3 consecutive sweeps with at most buffer.max_interval_s "
        "between them (sweeps in all: 5). --pairs uses two.",
    ]


def test_many_recordings_are_one_note():
    bags = [recording(f"bag_{n}", truth=None) for n in range(6)]
    _, (truth,) = notes(recordings=bags)
    assert truth.startswith("bag_0, bag_1, bag_2, bag_3 and 2 more: no ")


def test_failures_are_told_with_the_first_of_reasons_that_differ_in_numbers_alone():
    found = [
        row(1, "mnsf", 0.1),
        failed(3, "fnsf", "sweep 1700: 1.5 points are left."),
        failed(4, "fnsf", "sweep 1800: 2.5 points are left."),
        failed(5, "fnsf", "cancelled"),
        row(6, "fnsf", 0.1),
        dropped(2, "zero"),
        failed(1, "zero", "no points", recording="drive"),
    ]
    incomplete, others = notes(found)
    text = "examples without a flow: {}; the first, sweep {} of {}: {}.".format
    assert incomplete == [f"zero: {text(1, 1, 'drive', 'no points')} No flow at all: drive."]
    assert others[-2:] == [
        f"fnsf: {text(2, 3, 'street', 'sweep 1700: 1.5 points are left')}",
        f"fnsf: {text(1, 5, 'street', 'cancelled')}",
    ]


def test_truth_that_is_valid_nowhere_is_told():
    empty = {name: replace(one, num_points=0) for name, one in row(1, "mnsf", 0.1).errors.items()}
    _, others = notes([row(1, "mnsf", 0.1, errors=empty)])
    assert others == ["street: no scored point has valid truth, so no errors."]


def test_lost_ego_motion_is_noted_once_for_each_method_and_recording():
    lost = [row(n, "mnsf", 0.1, lost="clouds repeat" if n < 3 else "no match") for n in (1, 2, 3)]
    incomplete, others = notes([*lost, row(4, "mnsf", 0.1), row(4, "zero", 0.1)])
    assert not incomplete
    assert others == [
        "mnsf: ego motion lost in 3 of 4 sweeps of street, first in sweep 1: clouds repeat (2), "
        "no match (1)."
    ]
