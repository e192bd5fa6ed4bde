"""The report of a run's folder: where its pictures come from, and what it says without any."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import re
import shutil

import numpy as np
import pytest

from mnsf_ros.cli import report
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.executors import run_serially
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow
from mnsf_ros.evaluation.options import EvaluationOptions, evaluated_methods
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_json import plain, structured, to_json
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.report.closer_look import badness
from mnsf_ros.report.pictured_flows import (
    TimeBudget,
    estimated_examples,
    num_estimates,
    recorded_examples,
)
from mnsf_ros.report.run_report import report_run
from mnsf_ros.report.run_results import read_results
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

pytestmark = pytest.mark.usefixtures("without_drawing")

METHODS = ["ego", "zero"]


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "street"
    write_recording(SimulationSettings(seed=1, duration_s=0.5, num_beams=16, num_columns=256), path)
    return path


def evaluate(street, out, *, write_flow=False, warm=False, methods=METHODS):
    settings = preset("paper").changed({"crop.max_range_m": 30.0, "warm_start.enabled": warm})
    folder = out / "flow" if write_flow else None
    options = EvaluationOptions(settings, num_points=80, seed=3, flow_folder=folder)
    recording = choose_topics(inspect_recording(street), "street")
    methods = evaluated_methods(methods, options)
    record = RunRecord(options, methods, [recording], [SessionRecord.now([])])
    with RunFolder.opened(out, resume=False) as run_folder:
        for task, event in run_serially(run_folder.begin(record), options):
            run_folder.take(task, event)
    return out


def report_of(folder, **options):
    said = []
    path = report_run(read_results(RunFolder(folder)), folder, say=said.append, **options)
    assert path == folder / "report.html"
    return path.read_text(), said


def test_flows_that_were_written_are_drawn(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", write_flow=True)
    text, said = report_of(folder, num_pictured=2)
    assert said == []
    assert text.count("data:image/png") == 2 * (1 + 1)  # truth and ego; zero flow is no picture


def test_missed_movers_are_pictured_beside_the_worst_sweeps(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", methods=["ego"])
    item = ObjectRow(1, "car", True, 5.0, 12.0, 50, 0.0, place_m=(8.0, 3.0))
    rows = list(RunFolder(folder).rows)
    best = min(rows, key=badness)
    movers = MoverRow((0, 0, 50), 0, objects=[item])
    rows = [dataclasses.replace(row, movers=movers) if row is best else row for row in rows]
    (folder / "rows.jsonl").write_text("".join(f"{to_json(row)}\n" for row in rows))
    text, said = report_of(folder, num_pictured=1)
    assert said == ["estimating 2 sweeps again for pictures by ego, about 0 s"]
    # The worst sweep has two pictures, the missed mover of another one has one.
    assert text.count("data:image/png") == 2 + 1
    assert text.count("<h3>Missed: car in street</h3>") == 1


def test_other_flows_are_estimated_once_more(street, tmp_path):
    folder = evaluate(street, tmp_path / "run")
    text, said = report_of(folder, num_pictured=2)
    assert said == ["estimating 2 sweeps again for pictures by ego, zero, about 0 s"]
    assert text.count("Estimated again for the picture, from these sweeps alone</figcaption>") == 2
    assert text.count("data:image/png") == 2 * (1 + 1)  # truth and ego; zero flow is no picture
    assert "The picture shows another flow" not in text


def test_both_sources_give_the_same_pictures(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", write_flow=True)
    run, rows = RunFolder(folder).read_record(), list(RunFolder(folder).rows)
    rows = [row for row in rows if row.method == "ego"][:1]
    (recorded,) = recorded_examples(folder, rows, METHODS)
    (estimated,) = estimated_examples(run, rows, METHODS, TimeBudget())
    assert recorded.key == estimated.key
    np.testing.assert_array_equal(recorded.xyz, estimated.xyz)
    np.testing.assert_array_equal(recorded.truth, estimated.truth)
    for one, other in zip(recorded.flows, estimated.flows, strict=True):
        assert one.method == other.method
        np.testing.assert_array_equal(one.flow, other.flow)
        np.testing.assert_allclose(one.error_m, other.error_m, atol=1e-6)


def test_options_come_back_from_the_record(street, tmp_path):
    options = RunFolder(evaluate(street, tmp_path / "run")).read_record().options
    assert options.settings.crop.max_range_m == 30.0
    assert options.settings.ground.remove
    assert (options.num_points, options.seed) == (80, 3)


def test_run_of_another_version_is_reported_without_new_estimates(street, tmp_path):
    folder = evaluate(street, tmp_path / "run")
    record = folder / "run.json"
    record.write_text(json.dumps(json.loads(record.read_text()) | {"format": 2}))
    text, said = report_of(folder)
    assert "data:image/png" not in text
    (line,) = said
    assert "No pictures" in line
    assert line in text
    assert "another version" in line


def test_online_is_pictured_with_the_settings_of_its_row():
    """What was set explicitly comes back from the record, and no more than that."""
    before = EvaluationOptions(preset("paper").changed({"crop.min_range_m": 0.0}))
    after = structured(plain(before), EvaluationOptions)
    was, now = (make_method("online", one.settings).settings for one in (before, after))
    assert was == now
    assert now.crop.min_range_m == 0.0
    assert now.warm_start.enabled


def test_report_without_pictures(street, tmp_path):
    folder = evaluate(street, tmp_path / "run")
    text, said = report_of(folder, estimate_again=False)
    assert "data:image/png" not in text
    assert said == []
    assert "The worst 3 of 3 sweeps of ego" in text


@pytest.mark.parametrize("method", ["online", "mnsf-frames2"])
def test_methods_that_remember_earlier_sweeps_are_pictured_as_they_were_in_the_run(
    street, tmp_path, method
):
    folder = evaluate(street, tmp_path / "run", warm=True, methods=[method])
    text, said = report_of(folder, num_pictured=3)
    assert said[-1].startswith("estimating 3 sweeps again for pictures by ")
    assert text.count("data:image/png") == 3 * (1 + 1)
    captions = re.findall("Estimated again for the picture, ([^<]*)</figcaption>", text)
    assert sorted(captions) == [
        "after the 1 sweep before",
        "after the 2 sweeps before",
        "from these sweeps alone",
    ]
    run, rows = RunFolder(folder).read_record(), list(RunFolder(folder).rows)
    # The last one alone: those before it are estimated on the way.
    (example,) = estimated_examples(run, rows[-1:], [method], TimeBudget())
    assert np.nanmean(example.flows[0].error_m) == pytest.approx(badness(rows[-1]), abs=1e-6)
    assert num_estimates(run, rows[-1:], [method], TimeBudget()) == {method: rows[-1].number + 1}


def test_run_in_real_time_that_left_sweeps_out_differs_and_says_so(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", methods=["online"])
    rows = list(RunFolder(folder).rows)
    other = dataclasses.replace(rows[-1].errors["all"], epe_m=7.0)
    rows[-1] = dataclasses.replace(rows[-1], errors={**rows[-1].errors, "all": other})
    (folder / "rows.jsonl").write_text("".join(f"{to_json(row)}\n" for row in rows))
    text, _ = report_of(folder, num_pictured=1)
    assert re.search(r"mean error \d\.\d{4} m here, 7\.0000 m in the run", text)


def test_estimate_that_takes_too_long_is_not_begun(street, tmp_path):
    folder = evaluate(street, tmp_path / "run")
    rows = list(RunFolder(folder).rows)
    slow = [dataclasses.replace(row, time_ms=9e3 if row.method == "ego" else 1.0) for row in rows]
    (folder / "rows.jsonl").write_text("".join(f"{to_json(row)}\n" for row in slow))
    text, said = report_of(folder, limit_s=8.0)
    assert said == ["No pictures: one flow takes 9 s; `mnsf report` on the folder waits."]
    assert said[0] in text
    assert "data:image/png" not in text
    text, said = report_of(folder, limit_s=8.0, focus="zero")
    assert said == ["estimating 3 sweeps again for pictures by zero, ego, about 8 s"]
    assert text.count("<figcaption>zero: EPE") == 3
    assert "<figcaption>ego: EPE" not in text


def test_no_time_at_all_leaves_a_report(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", methods=["zero"])
    run, rows = RunFolder(folder).read_record(), list(RunFolder(folder).rows)
    assert estimated_examples(run, rows, ["zero"], TimeBudget(0.0)) == []


def test_time_of_the_last_estimate_counts():
    budget = TimeBudget(60.0, {"slow": 70.0, "fast": 0.1, "unknown": float("nan")})
    assert not budget.allows("slow")
    assert all(map(budget.allows, ("fast", "unknown", "never seen")))
    with budget.estimate("fast"):
        pass
    assert budget.needs_s("fast") == 0.1
    assert budget.left_s < 60.0


def test_report_is_there_when_its_pictures_are_interrupted(street, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("mnsf_ros.report.run_report.estimated_examples", interrupted)
    folder = evaluate(street, tmp_path / "run")
    with pytest.raises(KeyboardInterrupt):
        report_of(folder)
    assert "The worst 3 of 3 sweeps of ego" in (folder / "report.html").read_text()


def test_recording_that_is_gone_costs_only_the_pictures(street, tmp_path):
    moved = tmp_path / "street"
    shutil.copytree(street, moved)
    folder = evaluate(moved, tmp_path / "run")
    shutil.rmtree(moved)
    text, said = report_of(folder)
    assert "data:image/png" not in text
    assert said[-1].startswith("No pictures: ")
    assert "No pictures: " in text


def test_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(MnsfError, match=r"holds no run, run\.json is missing"):
        report_of(tmp_path)


@pytest.mark.parametrize(
    "record",
    ["{}", '{"methods": 3}', '{"methods": []}', '{"methods": ["ego"], "recordings": [3]}'],
)
def test_record_of_something_else_is_refused(tmp_path, record):
    (tmp_path / "run.json").write_text(record)
    with pytest.raises(MnsfError, match=r"run\.json: is not the record of a run") as info:
        report_of(tmp_path)
    assert "\n" not in str(info.value)


def test_method_that_the_run_does_not_have_is_refused(street, tmp_path):
    folder = evaluate(street, tmp_path / "run")
    with pytest.raises(MnsfError, match=r"run: has no method 'mnfs'; it has ego, zero$"):
        report_of(folder, focus="mnfs")
    assert not (folder / "report.html").exists()


def test_command_line(street, tmp_path, capsys):
    folder = evaluate(street, tmp_path / "run")
    parser = argparse.ArgumentParser()
    report.add_to(parser.add_subparsers())
    options = parser.parse_args(["report", str(folder), "--pictures", "1", "--method", "zero"])
    options.run(options)
    assert "report.html" in capsys.readouterr().out.replace("\n", "")
    text = (folder / "report.html").read_text()
    assert "Worst sweeps of zero" in text
    assert text.count("data:image/png") == 3


@pytest.mark.parametrize(("limit_s", "number"), [(math.inf, 31), (12.0, 12), (1.0, 9)])
def test_as_many_sweeps_before_are_estimated_as_time_allows(street, tmp_path, limit_s, number):
    folder = evaluate(street, tmp_path / "run", methods=["online", "zero"])
    run, (row, *_) = RunFolder(folder).read_record(), RunFolder(folder).rows
    late = [dataclasses.replace(row, number=100)]
    budget = TimeBudget(limit_s, {"online": 1.0, "zero": 1.0})
    counts = num_estimates(run, late, ["online", "zero"], budget)
    assert counts == {"online": number, "zero": 1}
