# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf doctor`: what it says of recordings, and its exit status."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from box_street import BoxStreet, pose, unrelated_sweep

from mnsf_ros.cli import main
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import LIDAR_FRAME
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from msg_utils.point_cloud2 import encode_columns


@pytest.fixture(scope="module")
def street(make_street):
    return make_street(duration_s=1.0, num_beams=32, num_columns=256)


@pytest.fixture(scope="module")
def on_its_side(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "on_its_side"
    turn = np.eye(4)[[0, 2, 1, 3]] * (1.0, 1.0, -1.0, 1.0)
    settings = SimulationSettings(duration_s=0.5, num_beams=32, num_columns=256)
    with BagWriter(path) as writer:
        for sweep in SweepSimulator(settings):
            xyz, flow = (
                one @ turn[:3, :3].astype(np.float32) for one in (sweep.xyz, sweep.truth.flow)
            )
            truth = replace(sweep.truth, flow=flow)
            turned = replace(sweep, xyz=xyz, truth=truth, pose=sweep.pose @ turn)
            writer.write_sweep(turned, LIDAR_FRAME)
    return path


def said(capsys, *arguments):
    status = main.run([*map(str, arguments)])
    text = capsys.readouterr()
    return status, text.out, text.err


def test_a_street_is_described(street, capsys):
    status, text, _ = said(capsys, "doctor", street)
    assert status == 0
    assert "10.0 Hz" in text
    assert "no returns" not in text
    assert "x y z intensity ring" in text
    assert "odometry         differs from registration by 0.0" in text
    assert text.endswith("Nothing wrong was found; notes: 1.\n")
    assert "examined" not in text
    _, text, _ = said(capsys, "doctor", street, "--duration-s=0.35")
    assert "/points, 10 clouds, examined: the first 0.35 s\n" in text


def test_what_is_wrong_is_said_with_what_mends_it(on_its_side, capsys):
    status, text, _ = said(capsys, "doctor", on_its_side)
    assert status == 1
    assert "error: z is 90 degrees off the normal of the ground, up is nearest to y\n" in text
    status, text, _ = said(capsys, "doctor", on_its_side, "--json")
    content = json.loads(text)
    assert status == 1
    assert content["findings"][0]["severity"] == "error"
    assert content["findings"][0]["assumption"] == "z is up"
    assert content["facts"]["frame"] == "lidar"


def test_damage_is_an_error(street, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    whole = next(street.glob("*.mcap")).read_bytes()
    cut.write_bytes(whole[: len(whole) * 6 // 10])
    status, text, _ = said(capsys, "doctor", cut)
    assert status == 1
    assert f"error: the recording is damaged: {cut}, byte " in text
    assert "`mcap recover` keeps what can be read" in text
    assert "Nothing wrong" not in text
    assert "checksums" not in text


@pytest.mark.parametrize(
    ("num_clouds", "text"),
    [(1, "error: clouds: 1, a flow needs 2"), (5, "error: a cloud has 3 measured points")],
)
def test_what_can_have_no_flow_is_wrong(num_clouds, text, tmp_path, capsys):
    with BagWriter(tmp_path / "few") as writer:
        for number in range(num_clouds):
            columns = {axis: np.arange(1, 4, dtype=np.float32) for axis in "xyz"}
            cloud = encode_columns(columns, 1, 3)
            writer.write_cloud("/points", cloud, 10**9 + number * 10**8, "lidar")
    status, found, _ = said(capsys, "doctor", tmp_path / "few")
    assert status == 1
    assert text in found


def test_an_evaluation_says_it_after_its_tables(on_its_side, tmp_path, capsys):
    options = "--methods", "zero", "--pictures", "0", "--out", tmp_path / "out"
    status, text, _ = said(capsys, "evaluate", on_its_side, *options)
    assert status == 0
    assert "Input of on_its_side: z is 90 degrees off the normal" in text


def test_a_recording_that_cannot_be_read_is_refused(street, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for source, hint in (
        (tmp_path / "none.mcap", ""),
        ("/usr/no_recording", ""),  # the name could be that of a topic
        ("points", " (a topic: /points)"),
    ):
        status, _, text = said(capsys, "doctor", source)
        assert status == 2
        assert text == f"mnsf: {source}: no such file or folder{hint}\n"
    status, _, text = said(capsys, "doctor", street, "--points", "/none")
    assert status == 2
    assert "/none" in text


def test_a_recording_is_not_written_under_the_name_of_another_format(tmp_path, capsys):
    status, _, text = said(capsys, "simulate", tmp_path / "street.db3")
    assert status == 2
    assert "name a folder, or a file that ends in .mcap" in text


def test_sweeps_without_ego_motion_are_an_error(tmp_path, capsys):
    street, path = BoxStreet(), tmp_path / "lost"
    with BagWriter(path) as writer:
        for index in range(10):
            xyz = (
                unrelated_sweep(6).xyz if index == 6 else street.xyz(pose(0.6 * index), seed=index)
            )
            columns = {axis: xyz[:, i].astype(np.float32) for i, axis in enumerate("xyz")}
            cloud = encode_columns(columns, 1, len(xyz))
            writer.write_cloud("/points", cloud, 10**9 + index * 10**8, LIDAR_FRAME)
    status, text, _ = said(capsys, "doctor", path)
    assert status == 1
    assert (
        "error: the ego motion is lost in 2 of 8 sweeps, first at 1.600 s: the sweep does not "
        "match those before it (2)\n  Check there for gaps"
    ) in text
    out = tmp_path / "flow.mcap"
    status, text, error = said(capsys, "estimate", path, "--out", out)
    assert status == 0
    assert text.endswith("flow.mcap: 8 sweeps with flow\n")
    assert "the ego motion is lost in 2 of them: the sweep does not match" in error
    with BagReader(out) as reader:
        sources = [one.data for one in reader.messages("/scene_flow/ego_motion/source")]
        assert sources == [*4 * ["registration"], "lost", "lost", *2 * ["registration"]]
        assert reader.topics["/scene_flow/predicted"].count == 6
        assert reader.topics["/scene_flow/objects"].count == 8
    status, _, _ = said(capsys, "evaluate", path, "--methods=online", f"--out={tmp_path / 'run'}")
    assert status == 0
    table = pd.read_csv(tmp_path / "run" / "results.csv")
    assert table["num_lost"].tolist() == [2, 2]
    assert "ego motion lost in 2 of 8 sweeps" in (tmp_path / "run" / "results.md").read_text()
