# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf explain`: what it says of a place, and what it cannot say."""

import re

import numpy as np
import pytest
from recorded_truth import read_truth

from mnsf_ros.cli import main
from mnsf_ros.recording.bag_reader import BagReader
from msg_utils.point_cloud2 import decode_points


@pytest.fixture(scope="module")
def street(make_street):
    return make_street(duration_s=0.6, num_beams=32, num_columns=512)


@pytest.fixture(scope="module")
def sweep(street):
    """Stamp, points and truth of the sweep before the last one."""
    with BagReader(street) as reader:
        *_, message, _ = reader.messages("/points")
        points = decode_points(message).ravel()
        truth = read_truth(reader)
        stamp_ns = list(truth)[-2]
        return stamp_ns, np.stack([points[axis] for axis in "xyz"], axis=1), truth[stamp_ns]


def explained(capsys, *arguments):
    status = main.run(["explain", *map(str, arguments)])
    said = capsys.readouterr()
    return status, said.out, said.err


def at(points):
    x, y, _ = np.median(points, axis=0)
    return f"--at={x:.2f},{y:.2f}"


def seconds(stamp_ns):
    return f"--stamp={stamp_ns // 10**9}.{stamp_ns % 10**9:09}"


def test_mover_and_ground(street, sweep, capsys, tmp_path):
    stamp_ns, xyz, truth = sweep
    ids = truth.object_id
    movers = [i for i in np.unique(ids[truth.dynamic]) if (ids == i).sum() > 100]
    nearest = min(movers, key=lambda i: np.hypot(*xyz[ids == i, :2].T).min())
    picture, place = tmp_path / "car.png", at(xyz[ids == nearest])
    status, text, _ = explained(capsys, street, seconds(stamp_ns), place, "--picture", picture)
    assert status == 0
    assert f"street, sweep 4, stamp {stamp_ns / 1e9:.3f} s" in text
    assert re.search(r"Called dynamic: (\d+) of \1 points", text)
    assert "Reason: dynamic\nDecided by the stage: gate\n" in text
    shares = r"\(hit \d+%, passed through \d+%, hidden \d+%\)"
    match = rf"0\.\d+ m {shares}"
    assert re.search(rf"Sweep at \+0\.1 s: if static {match}; if it moves {match}\n", text)
    assert re.search(rf"Sweep at -0\.1 s: if static {match}; if it moves {match}\n", text)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert re.search(r"Truth: \d+% of the points dynamic", text)
    far = truth.ground & (np.hypot(*xyz[:, :2].T) > 6)
    picture, place = tmp_path / "road.png", at(xyz[far][:1])
    status, text, _ = explained(capsys, street, seconds(stamp_ns), place, "--picture", picture)
    assert (status, "Called dynamic: 0 of" in text) == (0, True)
    assert (f"{picture}: not written" in text, picture.exists()) == (True, False)
    assert "Motion found" not in text
    assert "Decided by the stage: no object\n" in text


def test_damage_is_told_with_a_status_of_its_own(street, sweep, capsys, tmp_path):
    cut, whole = tmp_path / "cut.mcap", next(street.glob("*.mcap")).read_bytes()
    cut.write_bytes(whole[:-8])
    status, text, error = explained(capsys, cut, seconds(sweep[0]), at(sweep[1][:1]))
    assert status == 5
    assert "Decided by the stage" in text
    assert f"{cut}: it has no index that can be read" in error


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (["--stamp=5", "--at=8,0"], "the stamp 5.000 s; the nearest one has 17164512"),
        (["--at=1000,0"], r"no point within 2 m of \(1000, 0\) m"),
        (["--at", "-1000,2"], r"no point within 2 m of \(-1000, 2\) m"),
        (["--at=8,0", "--method=zero"], "gives no reasons; online does"),
        (["--at=8,0", "--points=/nothing"], "/nothing"),
    ],
)
def test_what_cannot_be_explained_is_one_line(street, sweep, capsys, changes, text):
    status, out, err = explained(capsys, street, seconds(sweep[0]), *changes)
    assert (status, out) == (2, "")
    assert re.search(text, err)
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("stamp", "place"),
    [("nan", "1,2"), ("1e999999", "1,2"), ("5", "1"), ("5", "1,nan"), ("5", "a,b")],
)
def test_arguments_that_are_no_numbers_are_refused(street, capsys, stamp, place):
    assert main.run(["explain", str(street), f"--stamp={stamp}", f"--at={place}"]) == 2
    assert "expected" in capsys.readouterr().err
