# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf study` as users run it, on a street that is simulated in a second."""

import pytest

from mnsf_ros.cli.main import EXIT_USAGE, run
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.bag_writer import BagWriter

pytestmark = pytest.mark.usefixtures("without_drawing")

FEW_STEPS = [
    f"--set={setting}"
    for setting in (
        "crop.max_range_m=20",
        "distance.kind=tree",
        "field.num_hidden_layers=2",
        "field.hidden_width=8",
        "fusion.hidden_width=8",
        "optimization.max_iterations=3",
        "fusion.max_iterations=3",
    )
]


@pytest.fixture(scope="module")
def street(make_street):
    return make_street()


def study(name, *arguments):
    """Options may stand anywhere."""
    return run(["study", *FEW_STEPS, name, "--num-points", "100", *map(str, arguments)])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["fusion", "--max-examples=-1"], "max_examples: got -1"),
        (["fusion", "--set=crop.max_range=3"], "unknown setting 'crop.max_range'"),
        (["fusion", "/nowhere"], "/nowhere"),
        (["stability", "--sizes=many"], "sizes: got many, expected 3 or more numbers"),
        (["stability", "--methods=mnfs"], "unknown method 'mnfs'"),
        (["stability", "--sizes=16,32,100000"], "sizes: got 100000"),
        (["stability", "--sizes=64,128"], "sizes: got 64,128, expected 3 or more numbers"),
        (["stability", "--repeats=0"], "repeats: got 0, expected a whole number from 1 to"),
        (["landscape", "--steps=4"], "steps: got 4, expected an odd number"),
        (["landscape", "--directions=0"], "directions: got 0, expected a whole number from 2 to"),
        (["landscape", "--radius=inf"], "radius: got inf, expected a number from 0.001 to 10"),
        (["landscape", "--set=ego_motion.removed=true"], "ego_motion.removed is true, expected"),
    ],
)
def test_what_cannot_be_used_is_one_line(street, tmp_path, capsys, arguments, text):
    name, *others = arguments
    bags = [] if "/nowhere" in others else [street]
    assert study(name, *bags, *others, "--out", tmp_path / "out") == EXIT_USAGE
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
    assert study("fusion", bare, "--out", tmp_path / "out") == EXIT_USAGE
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
    assert study(name, street, *gaps, "--out", tmp_path / "out") == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line
