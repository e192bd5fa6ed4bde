# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run's folder: where its pictures come from, and what it says without any."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from mnsf_ros.cli import report
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.examples import read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow
from mnsf_ros.evaluation.options import EvaluationOptions, evaluated_methods
from mnsf_ros.evaluation.parallel import run_serially
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_json import from_json, to_json
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.shown_flows import ShownFlow, ShownFlowChooser, ShownFlows
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.report.page import write_report
from mnsf_ros.report.run_results import read_results
from mnsf_ros.report.run_tables import tables_of
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

pytestmark = pytest.mark.usefixtures("without_drawing")

METHODS = ["ego", "zero"]


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "street"
    write_recording(SimulationSettings(seed=1, duration_s=0.5, num_beams=16, num_columns=256), path)
    return path


def evaluate(street, out, *, methods=METHODS, resume=False, num_events=None, **values):
    """Runs what is left to do; `num_events`: killed after so many."""
    settings = preset("paper").changed({"crop.max_range_m": 30.0, "warm_start.enabled": False})
    options = EvaluationOptions(settings, num_points=80, seed=3, **values)
    recording = choose_topics(inspect_recording(street), "street")
    methods = evaluated_methods(methods, options)
    record = RunRecord(options, methods, [recording], [SessionRecord.now([])])
    folder = RunFolder(out)
    with folder.opened(resume=resume):
        for number, (task, event) in enumerate(run_serially(folder.begin(record), options)):
            if number == num_events:
                break
            folder.take(task, event)
    return folder


def report_of(folder, number=3, focus=None):
    results = read_results(folder, focus)
    path = write_report(folder, results, tables_of(results), number)
    assert path == folder.path / "report.html"
    return path.read_text()


def files(folder):
    return sorted(file.name for file in (folder.path / "pictures").iterdir())


def worst_of(folder, method):
    rows = sorted(
        (row for row in folder.rows if row.method == method), key=lambda row: -row.badness_m
    )
    return [row.number for row in rows]


def test_flow_of_the_worst_sweeps_of_each_method_is_kept_and_drawn(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", num_pictured=2)
    worst = {method: worst_of(folder, method) for method in METHODS}
    expected = [f"street.{m}.{number}.npz" for m in METHODS for number in sorted(worst[m][:2])]
    assert files(folder) == sorted(expected)
    text = report_of(folder, 2)
    assert text.count("<figcaption>ego: EPE") == text.count("<figcaption>Truth") == 2
    assert text.count("data:image/png") == 2 * (1 + 1)  # truth and ego; zero flow is no picture
    assert "have no picture" not in text
    text = report_of(folder, 3)
    assert "1 of 3 sweeps have no picture" in text
    assert report_of(folder, 2, "zero").count("<figcaption>zero: EPE") == 2


@pytest.mark.parametrize("method", ["ego", "online"])
def test_kept_flow_is_the_one_that_was_scored(street, tmp_path, method):
    folder = evaluate(street, tmp_path / "run", methods=[method], num_pictured=2)
    for row in folder.rows:
        flow = folder.flows.find(row)
        assert (flow is not None) == (row.number in worst_of(folder, method)[:2])
        if flow is not None:
            assert np.nanmean(flow.error_m) == pytest.approx(row.badness_m, abs=1e-6)


def test_written_and_kept_flow_are_the_same(street, tmp_path):
    kept = evaluate(street, tmp_path / "kept", num_pictured=1)
    written = evaluate(street, tmp_path / "written", flow_folder=tmp_path / "written" / "flow")
    assert not (written.path / "pictures").exists()
    worst, *_ = worst_of(kept, "ego")
    (row,) = [row for row in kept.rows if (row.method, row.number) == ("ego", worst)]
    one, other = kept.flows.find(row), written.flows.find(row)
    for name in ("xyz", "flow", "truth", "error_m"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    # All methods beside each other.
    assert report_of(written, 2).count("data:image/png") == 2 * (1 + 1)


@pytest.mark.parametrize("num_events", range(1, 6))
def test_killed_and_resumed_run_has_the_same_pictures(street, tmp_path, num_events):
    whole = evaluate(street, tmp_path / "whole", methods=["ego"], num_pictured=2)
    evaluate(street, tmp_path / "run", methods=["ego"], num_pictured=2, num_events=num_events)
    resumed = evaluate(street, tmp_path / "run", methods=["ego"], num_pictured=2, resume=True)
    assert files(resumed) == files(whole)
    assert len(list(resumed.rows)) == len(list(whole.rows))


def shown(method, number, rank, mover=None, recording="street"):
    points = np.zeros((4, 3), np.float32)
    return ShownFlow(
        recording, method, number, points, points, points[:, 0], mover=mover, rank=rank
    )


def test_no_more_flows_are_kept_than_are_shown(tmp_path):
    flows = ShownFlows(tmp_path)
    for number, rank in enumerate([3.0, 1.0, 2.0, 0.5, 4.0]):
        flows.add(shown("ego", number, rank), 2)
    flows.add(shown("ego", 1, 7, mover=5), 2)
    flows.add(shown("mnsf", 1, 0.1), 2)
    names = ["street.ego.0.npz", "street.ego.1.5.npz", "street.ego.4.npz", "street.mnsf.1.npz"]
    assert files(RunFolder(tmp_path)) == names
    # Another session goes on with what is there.
    again = ShownFlows(tmp_path)
    again.add(shown("ego", 9, 3.5, recording="other"), 2)
    assert "street.ego.0.npz" not in files(RunFolder(tmp_path))
    again.drop([("street", "ego")])
    assert files(RunFolder(tmp_path)) == ["other.ego.9.npz", "street.mnsf.1.npz"]


def test_missed_movers_are_kept_with_what_is_around_them(street):
    options = EvaluationOptions(preset("paper"))
    recording = choose_topics(inspect_recording(street), "street")
    with recording.open() as reader:
        example = next(read_examples(reader, recording, options, Findings()))
    flow = np.zeros_like(example.triplet.current.xyz)
    chooser = ShownFlowChooser(1)
    sizes = {1: [50, 70, 60], 2: [90], 3: [80, 10]}
    for number in range(3):
        objects = [
            ObjectRow(who, "car", True, 5.0, 12.0, points[number], 0.0, place_m=(8.0, 3.0))
            for who, points in sizes.items()
            if number < len(points)
        ]
        row = ResultRow("street", number, 1, "ego", 1, movers=MoverRow((0, 0, 1), 0, {}, objects))
        chooser.look(row, example, flow)
    assert chooser.new() == [], "without any figure to judge it by, no sweep is the worst one"
    (found,) = chooser.missed()
    assert (found.mover, found.number, found.rank) == (1, 1, 3)
    assert 0 < len(found.xyz) < np.count_nonzero(example.scored)
    assert (np.abs(found.xyz[:, :2] - (8.0, 3.0)) <= 12.0).all()
    assert ShownFlowChooser(0).missed() == []


def test_options_come_back_from_the_record(street, tmp_path):
    options = evaluate(street, tmp_path / "run").read_record().options
    assert options.settings.crop.max_range_m == 30.0
    assert options.settings.ground.remove
    assert (options.num_points, options.seed) == (80, 3)


def test_online_is_run_again_with_the_settings_of_its_row():
    """What was set explicitly comes back from the record, and no more than that."""
    before = EvaluationOptions(preset("paper").changed({"crop.min_range_m": 0.0}))
    after = from_json(to_json(before), EvaluationOptions)
    was, now = (make_method("online", one.settings).settings for one in (before, after))
    assert was == now
    assert now.crop.min_range_m == 0.0
    assert now.warm_start.enabled


def test_run_without_kept_flow_says_how_to_get_pictures(street, tmp_path):
    text = report_of(evaluate(street, tmp_path / "run"))
    assert "data:image/png" not in text
    assert "3 of 3 sweeps have no picture" in text
    assert "--pictures" in text
    assert "The worst 3 of 3 sweeps of ego" in text


def test_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(MnsfError, match=r"holds no run, run\.json is missing"):
        report_of(RunFolder(tmp_path))


@pytest.mark.parametrize(
    "record",
    ["{}", '{"methods": 3}', '{"methods": []}', '{"methods": ["ego"], "recordings": [3]}'],
)
def test_record_of_something_else_is_refused(tmp_path, record):
    (tmp_path / "run.json").write_text(record)
    with pytest.raises(MnsfError, match=r"run\.json: is not the record of a run") as info:
        report_of(RunFolder(tmp_path))
    assert "\n" not in str(info.value)


def test_method_that_the_run_does_not_have_is_refused(street, tmp_path):
    folder = evaluate(street, tmp_path / "run")
    with pytest.raises(MnsfError, match=r"run: has no method 'mnfs'; it has ego, zero$"):
        report_of(folder, focus="mnfs")
    assert not (folder.path / "report.html").exists()


def test_command_line(street, tmp_path, capsys):
    folder = evaluate(street, tmp_path / "run", num_pictured=2)
    parser = argparse.ArgumentParser()
    report.add_to(parser.add_subparsers())
    options = parser.parse_args(["report", str(folder.path), "--pictures=1", "--method=zero"])
    options.run(options)
    assert "report.html" in capsys.readouterr().out.replace("\n", "")
    text = (folder.path / "report.html").read_text()
    assert "Worst sweeps of zero" in text
    assert text.count("<figcaption>zero: EPE") == 1
