# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Every study from its name to its files, on a tiny street and with few steps."""

import csv
from dataclasses import replace
from functools import cache

import pytest

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.studies.stability_study import STABILITY_SETTINGS, stability_settings
from mnsf_ros.studies.study import STUDIES, CaseStudySettings, StudyOptions, run_study
from msg_utils.other_clouds import CLOUD_TYPE

FEW_STEPS = {
    "crop.max_range_m": 20.0,
    "distance.kind": "tree",
    "field.num_hidden_layers": 2,
    "field.hidden_width": 8,
    "fusion.hidden_width": 8,
    "optimization.max_iterations": 3,
    "fusion.max_iterations": 3,
}
SMALL = CaseStudySettings(
    directions=2,
    sizes="16,32,64",
    repeats=1,
    methods="fnsf,mnsf",
    warm_steps="1,3",
    cold_steps="2",
)
WITH_PICTURE = ("landscape", "warm-start")


@pytest.fixture(scope="module")
def street(make_street):
    return make_street(duration_s=0.7)


def options_in(folder, street):
    return StudyOptions(
        out=folder / "study",
        evaluation=EvaluationOptions(
            preset("paper").changed(FEW_STEPS), num_points=100, max_examples=2
        ),
        recordings=chosen_recordings([street]),
        case=SMALL,
    )


@pytest.fixture
def options(tmp_path, street):
    return options_in(tmp_path, street)


@pytest.fixture(autouse=True)
def without_pictures_of_sweeps(monkeypatch):
    monkeypatch.setattr("mnsf_ros.evaluation.pictures.frame", lambda *_: b"PNG")


@pytest.fixture(scope="module")
def studied(tmp_path_factory, street):
    """Does a study by its name, once for all tests; returns its result and its files."""

    @cache
    def study(name):
        return run_study(name, options_in(tmp_path_factory.mktemp("studies"), street))

    return study


def rows_of(paths):
    with paths[1].open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", STUDIES)
def test_study_writes_page_and_numbers_and_some_a_picture(name, studied):
    result, paths = studied(name)
    assert [path.name for path in paths[:2]] == [f"{name}.md", f"{name}.csv"]
    page = paths[0].read_text()
    assert page.startswith(f"# {result.title}\n")
    for fact in ("* seed: 0", "| field.hidden_width | 8 |", "* torch: "):
        assert fact in page
    assert (f"({name}.png)" in page) == (name in WITH_PICTURE) == (len(paths) == 3)
    assert len(rows_of(paths)) == len(result.numbers) > 0
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in paths[2:])


@pytest.mark.parametrize("name", ["ablation", "landscape", "stability", "warm-start"])
def test_study_is_the_same_the_second_time(name, studied, options):
    tables = []
    for _, paths in (studied(name), run_study(name, options)):
        rows = rows_of(paths)
        tables.append([{k: v for k, v in row.items() if k != "time_ms"} for row in rows])
    assert tables[0] == tables[1]


def test_method_study_has_so_many_examples_and_can_be_resumed(options):
    said = []
    options = replace(options, say=said.append)
    run_study("fusion", options)
    num_rows = len(RunFolder(options.out / "evaluation").read()[1])
    assert num_rows == 2 * 4
    assert said[-1].startswith("8: mnsf+fusion.kind=mlp, street sweep 2: EPE ")
    with pytest.raises(MnsfError, match="exists already"):
        run_study("fusion", options)
    run_study("fusion", replace(options, resume=True))
    assert len(RunFolder(options.out / "evaluation").read()[1]) == num_rows
    others = replace(options.evaluation, max_examples=0)
    with pytest.raises(MnsfError, match="max_examples"):
        run_study("fusion", replace(options, resume=True, evaluation=others))


def test_warm_networks_go_on_and_cold_ones_start_with_each_sweep(studied):
    _, paths = studied("warm-start")
    rows = rows_of(paths)
    names = ["warm, 1 step", "warm, 3 steps", "cold, 2 steps", "online"]
    places = [(row["variant"], row["sweep"], row["since_start"]) for row in rows]
    assert places == [(name, number, number) for name in names for number in ("1", "2")]
    assert all(float(row["dynamic_epe_m"]) > 0 and float(row["time_ms"]) > 0 for row in rows)
    page = paths[0].read_text()
    for text in ("| field.hidden_width | 8 |", "| live.enabled | True |", "points of a sweep: all"):
        assert text in page
    evaluation = RunFolder(paths[0].parent / "evaluation").read()[1]
    steps = {
        (row.method.removeprefix("mnsf/mnsf+"), row.number): row.iterations["forward"]
        for row in evaluation
        if row.method != "online"
    }
    assert steps == {
        ("optimization.max_iterations=1", 1): 40,
        ("optimization.max_iterations=1", 2): 1,
        ("optimization.max_iterations=3", 1): 40,
        ("optimization.max_iterations=3", 2): 3,
        ("warm_start.enabled=false+live.first_iterations=2", 1): 2,
        ("warm_start.enabled=false+live.first_iterations=2", 2): 2,
    }


def test_warm_start_needs_the_first_recording_alone_and_can_be_resumed(options, tmp_path):
    nowhere = replace(options.recordings[0], path=str(tmp_path / "nowhere"))
    options = replace(options, recordings=(*options.recordings, nowhere))
    _, paths = run_study("warm-start", options)
    before = rows_of(paths)
    assert rows_of(run_study("warm-start", replace(options, resume=True))[1]) == before


def test_settings_that_were_asked_for_stay():
    ours = stability_settings(preset("paper"))
    asked = stability_settings(preset("paper").changed({"optimization.max_iterations": 7}))
    assert ours.to_mapping().items() >= STABILITY_SETTINGS.items()
    assert asked.optimization.max_iterations == 7


def command(name, *arguments):
    """Runs `mnsf study`; options may stand anywhere."""
    few = [f"--set={setting}={value}" for setting, value in FEW_STEPS.items()]
    return run(["study", *few, name, "--num-points", "100", *map(str, arguments)])


def test_command_prints_what_it_does_and_finds(street, tmp_path, capsys):
    assert command("fusion", "--max-examples=1", street, "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    for text in ("weighted sum", "EPE (m)", "4: mnsf+fusion.kind=mlp", "Written: "):
        assert text in printed


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["fusion", "--max-examples=-1"], "--max-examples: got -1"),
        (["fusion", "--set=crop.max_range=3"], "unknown setting 'crop.max_range'"),
        (["fusion", "/nowhere"], "/nowhere"),
        (["stability", "--sizes=many"], "sizes: got many, expected 3 or more numbers"),
        (["stability", "--methods=mnfs"], "unknown method 'mnfs'"),
        (["stability", "--sizes=16,32,100000"], "sizes: got 100000"),
        (["stability", "--sizes=64,128"], "sizes: got 64,128, expected 3 or more numbers"),
        (["stability", "--repeats=0"], "--repeats: got 0, expected a whole number from 1 to"),
        (["warm-start", "--warm-steps=8,4"], "warm_steps: got 8,4, expected 1 or more numbers"),
        (["warm-start", "--cold-steps=0"], "cold_steps: got 0, expected 1 or more numbers from 1"),
        (["landscape", "--directions=0"], "--directions: got 0, expected a whole number from 2 to"),
        (["landscape", "--set=ego_motion.removed=true"], "ego_motion.removed is true, expected"),
    ],
)
def test_what_cannot_be_used_is_one_line(street, tmp_path, capsys, arguments, text):
    name, *others = arguments
    bags = [] if "/nowhere" in others else [street]
    assert command(name, *bags, *others, "--out", tmp_path / "out") == EXIT_USAGE
    printed = capsys.readouterr()
    lines = printed.err.splitlines()
    assert len(lines) == 1
    assert text in lines[0]
    for work in ("fitting", "looking around", "1 of "):
        assert work not in printed.out


def test_recording_without_truth(tmp_path, street, capsys):
    bare = tmp_path / "bare"
    with BagReader(street) as reader, BagWriter(bare) as writer:
        for stamp_ns, cloud in reader.raw_messages("/points"):
            writer.write_raw("/points", CLOUD_TYPE, stamp_ns, cloud)
    assert command("fusion", bare, "--out", tmp_path / "out") == EXIT_USAGE
    assert "the recordings hold no true flow" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("fusion", "no example could be scored: No example: street contains no 3 "),
        ("landscape", "the recordings hold no three sweeps in a row"),
    ],
)
def test_recording_without_examples(street, tmp_path, capsys, name, text):
    gaps = ["--set=buffer.max_interval_s=0.05", "--set=buffer.min_interval_s=0.01"]
    assert command(name, street, *gaps, "--out", tmp_path / "out") == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line
