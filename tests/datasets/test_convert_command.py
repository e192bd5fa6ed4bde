# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tiny_world

from mnsf_ros.cli import convert
from mnsf_ros.datasets.formats import FORMATS, open_source
from mnsf_ros.errors import DatasetError, RecordingError

DOCUMENT = Path(__file__).parents[2] / "docs" / "recordings.md"


def run(*arguments):
    parser = argparse.ArgumentParser(prog="mnsf")
    convert.add_to(parser.add_subparsers())
    options = parser.parse_args(["convert", *map(str, arguments)])
    options.run(options)


@pytest.fixture
def triplet(tmp_path):
    tiny = [tiny_world.sweep(index) for index in range(3)]
    flow = tiny_world.expected_flow(1, tiny[1].xyz, tiny[1].part)
    points = {f"pc{index + 1}": one.xyz for index, one in enumerate(tiny)}
    path = tmp_path / "triplet.npz"
    np.savez(path, flow23=flow, label_valid=np.arange(len(flow)) % 2 == 0, **points)
    return path


def test_a_file_is_converted(tmp_path, triplet, capsys):
    out = tmp_path / "out.mcap"
    run("triplets", triplet, out, "--first", 1, "--count", 2)
    found = tiny_world.read(out)
    assert len(found.stamps) == 2
    assert found.truth[0].valid.mean() == pytest.approx(0.5, abs=0.01)
    said = capsys.readouterr().out
    assert f"2 sweeps in {out}" in said
    assert re.search(r"flow of \d+\.\d% of the points is valid, \d\.\d% of these are dynamic", said)
    assert "warning" not in said
    with pytest.raises(RecordingError, match="exists already"):
        run("triplets", triplet, out)
    assert capsys.readouterr().out == "", "no bar of what will not be done"
    run("triplets", triplet, out, "--force", "--unlabelled-static", "--compress")
    assert tiny_world.read(out).truth[1].valid.all()


def write_sweeps(folder, num_sweeps, **arrays):
    folder.mkdir()
    for index in range(num_sweeps):
        xyz = tiny_world.sweep(index).xyz
        stamp_ns = tiny_world.stamp_ns(index)
        np.savez(folder / f"{index}.npz", xyz=xyz, stamp_ns=stamp_ns, **arrays)
    return folder


@pytest.mark.parametrize(
    ("num_sweeps", "boxes", "reason"),
    [
        (2, None, "no sweep has labels; either there are none, or their stamps"),
        (2, '{"7": []}', "no sweep has labels; either there are none, or their stamps"),
        (2, '{"1": []}', "labels reach no point of a sweep that has a next one"),
        (1, None, "a single sweep has no next one"),
    ],
)
def test_a_recording_without_valid_flow_comes_with_a_warning(
    tmp_path, capsys, num_sweeps, boxes, reason
):
    source = write_sweeps(tmp_path / "in", num_sweeps, pose=np.eye(4))
    if boxes is not None:
        (source / "boxes.json").write_text(boxes)
    run("sweeps", source, tmp_path / "out")
    said = capsys.readouterr().out
    assert "flow of 0.0% of the points is valid" in said
    assert f"warning: no point has valid flow: {reason}" in said
    run("sweeps", source, tmp_path / "out", "--unlabelled-static", "--force")
    assert ("no point has valid flow" in capsys.readouterr().out) == (num_sweeps == 1)


def test_gaps_in_the_odometry_come_with_a_warning(tmp_path, capsys):
    source = write_sweeps(tmp_path / "in", 3, pose=np.eye(4))
    np.savez(source / "2.npz", xyz=tiny_world.sweep(2).xyz, stamp_ns=tiny_world.stamp_ns(2))
    run("sweeps", source, tmp_path / "out")
    assert "warning: 2 of 3 sweeps have a pose, the odometry" in capsys.readouterr().out


def write_endless_drive(folder):
    """A drive of KITTI with one sweep so often that its conversion takes many seconds."""
    for name in ("velodyne_points/data", "oxts/data"):
        (folder / name).mkdir(parents=True)
    sweep, reading = folder / "sweep", folder / "reading"
    np.ones(4, "<f4").tofile(sweep)
    reading.write_text("49 8.4 100 0 0 0 " + "0 " * 24)
    for number in range(9000):
        os.link(sweep, folder / f"velodyne_points/data/{number:010d}.bin")
        os.link(reading, folder / f"oxts/data/{number:010d}.txt")
    start = np.datetime64("2011-09-26T13:02:20", "ms")
    times = [f"{start + 100 * number}\n" for number in range(9000)]
    (folder / "velodyne_points/timestamps.txt").write_text("".join(times))
    (folder / "calib_imu_to_velo.txt").write_text("R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n")
    return folder


# Whoever runs the tests with nohup has all that they start ignore SIGHUP.
HEEDING_HANGUP = (
    "import runpy, signal; signal.signal(signal.SIGHUP, signal.SIG_DFL); "
    "runpy.run_module('mnsf_ros.cli', run_name='__main__')"
)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_nothing_behind(tmp_path, number):
    source, out = write_endless_drive(tmp_path / "in"), tmp_path / "out"
    command = [sys.executable, "-c", HEEDING_HANGUP, "convert", "kitti", str(source), str(out)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        deadline = time.monotonic() + 300
        while not list(tmp_path.glob(".out.*")) and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(number)
        _, errors = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == 130
    assert b"mnsf: interrupted" in errors
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_options_of_other_formats_are_refused(tmp_path, triplet):
    with pytest.raises(DatasetError, match="format 'triplets' takes no sequence, got 'one'"):
        run("triplets", triplet, tmp_path / "out", "--sequence", "one")
    with pytest.raises(DatasetError, match="format 'waymo' takes no labels"):
        run("waymo", tmp_path, tmp_path / "out", "--labels", tmp_path)
    with pytest.raises(DatasetError, match="format 'bag' is unknown, expected one of kitti"):
        open_source("bag", tmp_path)


@pytest.mark.parametrize("name", FORMATS)
def test_a_path_without_anything_is_an_error_of_one_line(tmp_path, name):
    with pytest.raises(DatasetError) as caught:
        run(name, tmp_path / "nowhere", tmp_path / "out")
    assert str(tmp_path / "nowhere") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_help_lists_all_formats(capsys):
    with pytest.raises(SystemExit):
        run("--help")
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in FORMATS)


def test_every_format_is_documented():
    headings = set(re.findall(r"^### `([\w-]+)`", DOCUMENT.read_text(encoding="utf-8"), re.M))
    assert headings == set(FORMATS)
