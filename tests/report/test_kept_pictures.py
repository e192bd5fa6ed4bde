# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of a report: drawn during the run, of the first and of the worst sweeps."""

import numpy as np
import pytest
from PIL import Image

from mnsf_ros.cli.main import run
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.options import EvaluationOptions, evaluated_methods
from mnsf_ros.evaluation.parallel import run_serially
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
    for number, (_, event) in enumerate(run_serially(tasks, options)):
        if number == num_events:
            break
        folder.take(event)
    return folder


def report_of(folder, focus=None):
    results = read_results(folder, focus)
    return write_report(folder, results).read_text()


def files(folder):
    pictures = folder.path / "pictures"
    return sorted(str(file.relative_to(pictures)) for file in pictures.glob("*/*"))


def worst_of(folder, method):
    rows = [row for row in folder.read()[1] if row.method == method]
    return [row.number for row in sorted(rows, key=lambda row: -row.badness_m)]


@without_drawing
def test_the_worst_sweeps_of_each_method_are_drawn(street, tmp_path):
    folder = evaluate(street, tmp_path / "run", pictures=2)
    worst = {method: worst_of(folder, method)[:2] for method in METHODS}
    expected = [f"street.{m}/sweep_{number}.png" for m in METHODS for number in worst[m]]
    assert files(folder) == sorted(expected)  # and no animation of references
    text = report_of(folder)
    assert text.count("data:image/png") == text.count("Middle: ego.") / 2 == 2
    assert run(["report", str(folder.path), "--method=zero"]) == 0
    text = (folder.path / "report.html").read_text()
    assert "Worst sweeps of zero" in text
    assert text.count("data:image/png") == text.count("Middle: zero.") / 2 == 2
    with pytest.raises(MnsfError, match=r"run: has no method 'mnfs'; it has ego, zero$"):
        report_of(folder, focus="mnfs")


def test_report_begins_with_the_first_sweeps_beside_their_truth(street, tmp_path):
    known = {"methods": ["ego", "online"], "pictures": 1}
    evaluate(street, tmp_path / "run", **known, num_events=6)
    folder = evaluate(street, tmp_path / "run", **known, resume=True)
    (file,) = folder.path.rglob("*.webp")
    images = Image.open(file)
    assert images.n_frames == 3
    left, right = np.hsplit(np.asarray(images)[:, 2:-2], 2)
    assert left.any()
    assert right.any()
    text = report_of(folder)
    assert text.count("data:image/webp") == 1
    assert text.index("data:image/webp") < text.index('id="results"')
    assert "street, the first scored sweeps. Left: truth. Right: online." in text


def test_pictures_that_cannot_be_drawn_cost_no_results(street, tmp_path, monkeypatch):
    monkeypatch.setattr("mnsf_ros.evaluation.pictures.frame", lambda *_: 1 / 0)
    folder = evaluate(street, tmp_path / "run", methods=["online"], pictures=1)
    record, rows = folder.read()
    assert (len(rows), len(record.finished)) == (3, 1)
    assert "data:image" not in report_of(folder)
