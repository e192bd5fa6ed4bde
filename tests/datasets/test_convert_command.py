# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf convert`: one command for all formats."""

import argparse
import re

import numpy as np
import pytest
import tiny_world

from mnsf_ros.cli import recordings
from mnsf_ros.cli.arguments import Arguments
from mnsf_ros.datasets.conversion import open_source
from mnsf_ros.datasets.formats import FORMATS
from mnsf_ros.errors import DatasetError, RecordingError


def run(*arguments):
    parser = argparse.ArgumentParser(prog="mnsf")
    recordings.add_convert(Arguments(parser))
    recordings.run_convert(parser.parse_args(list(map(str, arguments))))


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
    assert capsys.readouterr().out == "", "no bar before the check"
    run("triplets", triplet, out, "--force", "--unlabelled-static")
    assert tiny_world.read(out).truth[1].valid.all()


@pytest.mark.parametrize("boxes", ["{}", '{"1": []}'])
def test_no_valid_flow_comes_as_a_warning(tmp_path, capsys, boxes):
    source = tmp_path / "in"
    source.mkdir()
    for index in range(2):
        xyz, stamp_ns = tiny_world.sweep(index).xyz, tiny_world.stamp_ns(index)
        np.savez(source / f"{index}.npz", xyz=xyz, stamp_ns=stamp_ns, pose=np.eye(4))
    (source / "boxes.json").write_text(boxes)
    run("sweeps", source, tmp_path / "out")
    assert "warning: no point has valid flow: no sweep with labels" in capsys.readouterr().out
    run("sweeps", source, tmp_path / "out", "--unlabelled-static", "--force")
    assert "no point has valid flow" not in capsys.readouterr().out


def test_options_of_other_formats_are_refused(tmp_path, triplet):
    with pytest.raises(DatasetError, match="format 'triplets' takes no sequence"):
        run("triplets", triplet, tmp_path / "out", "--sequence", "one")


@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_source_is_an_error_of_one_line(tmp_path, name):
    with pytest.raises(DatasetError) as caught:
        list(open_source(name, tmp_path / "nowhere").sweeps)
    assert str(tmp_path / "nowhere") in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
