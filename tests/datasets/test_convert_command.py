from __future__ import annotations

import argparse
import re
from pathlib import Path

import numpy as np
import pytest
import tiny_world

from mnsf_ros.cli import convert
from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.formats import FORMATS, open_source
from mnsf_ros.errors import RecordingError

DOCUMENT = Path(__file__).parents[2] / "docs" / "datasets.md"


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
    assert f"2 sweeps in {out}" in capsys.readouterr().out
    with pytest.raises(RecordingError, match="exists already"):
        run("triplets", triplet, out)
    assert capsys.readouterr().out == "", "no bar of what will not be done"
    run("triplets", triplet, out, "--force", "--unlabelled-static", "--compress")
    assert tiny_world.read(out).truth[1].valid.all()


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
