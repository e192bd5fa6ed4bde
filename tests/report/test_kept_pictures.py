# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of a report: drawn during the run, of the first and of the worst sweeps."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from mnsf_ros.cli.main import run
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.options import EvaluationOptions, evaluated_methods
from mnsf_ros.evaluation.parallel import run_serially
from mnsf_ros.evaluation.pictures import Picture, Pictures
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord, session_now
from mnsf_ros.presets import preset
from mnsf_ros.report.page import write_report
from mnsf_ros.report.run_results import read_results
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

without_drawing = pytest.mark.usefixtures("without_drawing")

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
    recording = choose_topics(street, "street")
    methods = evaluated_methods(methods, options)
    record = RunRecord(options, methods, [recording], [session_now([])])
    folder = RunFolder(out)
    tasks = folder.begin(record, resume=resume)
    for number, (task, event) in enumerate(run_serially(tasks, options)):
        if number == num_events:
            break
        folder.take(task, event)
    return folder


def report_of(folder, number=3, focus=None):
    results = read_results(folder, focus)
    return write_report(folder, results, number).read_text()


def files(folder):
    pictures = folder.path / "pictures"
    return sorted(str(file.relative_to(pictures)) for file in pictures.rglob("worst_*.png"))


def worst_of(folder, method):
    rows = [row for row in folder.rows if row.method == method]
    return [row.number for row in sorted(rows, key=lambda row: -row.badness_m)]


@without_drawing
def test_the_worst_sweeps_of_each_method_are_drawn(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", num_pictured=2)
    worst = {method: worst_of(folder, method)[:2] for method in METHODS}
    assert len(files(folder)) == 4
    for row in folder.rows:
        assert (folder.pictures.find(row) is not None) == (row.number in worst[row.method])
    text = report_of(folder, 2)
    assert text.count("<figcaption>ego: EPE") == 2
    assert text.count("data:image/png") == 2  # the rival is a reference
    assert "data:image/webp" not in text  # of references
    assert "have no picture" not in text
    assert "1 of 3 sweeps have no picture" in report_of(folder, 3)
    assert run(["report", str(folder.path), "--pictures=1", "--method=zero"]) == 0
    text = (folder.path / "report.html").read_text()
    assert "Worst sweeps of zero" in text
    assert text.count("<figcaption>zero: EPE") == 1
    with pytest.raises(MnsfError, match=r"run: has no method 'mnfs'; it has ego, zero$"):
        report_of(folder, focus="mnfs")


@without_drawing
def test_killed_and_resumed_run_has_the_same_pictures(street, tmp_path):
    known = {"methods": ["ego-estimated"], "num_pictured": 2}
    whole = evaluate(street, tmp_path / "whole", **known)
    evaluate(street, tmp_path / "run", **known, num_events=3)
    resumed = evaluate(street, tmp_path / "run", **known, resume=True)
    assert files(resumed) == files(whole)
    assert len(list(resumed.rows)) == len(list(whole.rows))


def test_report_begins_with_the_first_sweeps_beside_their_truth(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", methods=["ego", "online"], num_pictured=1)
    frames = folder.pictures.frames("street", "online")
    assert list(frames) == [1, 2, 3]
    left, right = np.hsplit(np.asarray(Image.open(io.BytesIO(frames[1])))[:, 2:-2], 2)
    assert left.any()
    assert right.any()
    text = report_of(folder)
    assert text.count("data:image/webp") == 1
    assert text.index("data:image/webp") < text.index('id="results"')
    assert "street, the first 3 scored sweeps. Left: truth. Right: online." in text
    assert "data:image/webp" not in report_of(folder, 0)


def test_pictures_that_cannot_be_drawn_cost_no_results(street, tmp_path, monkeypatch):
    for name in ("example_picture", "frame"):
        monkeypatch.setattr(f"mnsf_ros.evaluation.pictures.{name}", lambda *_: 1 / 0)
    folder = evaluate(street, tmp_path / "run", methods=["online"], num_pictured=1)
    assert len(list(folder.rows)) == 3
    assert len(folder.finished()) == 1
    assert "1 of 1 sweeps have no picture" in report_of(folder, 1)


def picture(method, number, badness_m, recording="street"):
    return Picture(recording, method, number, b"PNG", badness_m)


def test_no_more_pictures_are_kept_than_are_shown(tmp_path):
    pictures, folder = Pictures(tmp_path), RunFolder(tmp_path)
    for number, badness_m in enumerate([3.0, 1.0, 2.0, 0.5, 4e-7, 14.0]):
        pictures.add(picture("ego", number, badness_m), 2)
    pictures.add(picture("ego", 1, 0.1, recording="other"), 2)
    names = ["other.ego/worst_0.1_1.png", "street.ego/worst_14.0_5.png"]
    assert files(folder) == [*names, "street.ego/worst_3.0_0.png"]
    # Another session goes on with what is there.
    Pictures(tmp_path).add(picture("ego", 9, 3.5), 2)
    assert files(folder) == [*names, "street.ego/worst_3.5_9.png"]
    pictures.drop([("street", "ego")])
    assert files(folder) == names[:1]
