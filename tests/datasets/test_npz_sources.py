# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import io
import json
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.conversion import open_source, write_recording
from mnsf_ros.datasets.pseudo_ground_truth import TruthSettings, sweep_truth
from mnsf_ros.errors import DatasetError


def read(name, source, out, first=0, count=None, **settings):
    opened = open_source(name, source).part(first, count)
    write_recording(opened, out, TruthSettings(**settings))
    return tiny_world.read(out)


# Sweeps.


def write_sweeps(folder, *, flow=False):
    folder.mkdir()
    boxes = {}
    for index in range(tiny_world.NUM_SWEEPS):
        tiny = tiny_world.sweep(index)
        arrays = {"ring": np.full(len(tiny.xyz), 3, np.uint8)}
        if flow and index < 2:
            arrays["flow"] = tiny_world.expected_flow(index, tiny.xyz, tiny.part)
            arrays["flow_valid"] = tiny.part != tiny_world.GONE
        np.savez(
            folder / f"sweep_{index}.npz",
            xyz=tiny.xyz,
            stamp_ns=np.int64(tiny_world.stamp_ns(index)),
            pose=tiny_world.world_from_sweep(index),
            **arrays,
        )
        boxes[str(index)] = [entry(*item) for item in tiny_world.boxes(index).items()]
    (folder / "boxes.json").write_text(json.dumps(boxes))
    return folder


def entry(track, pose):
    return {
        "track_id": track,
        "cls": "Van",
        "center": pose[:3, 3].tolist(),
        "size": tiny_world.SIZE.tolist(),
        "yaw": tiny_world.yaw(pose),
        "occluded": 0,
    }


def test_stamps_that_begin_before_zero_are_made_later(tmp_path):
    source = write_sweeps(tmp_path / "sweeps")
    for index, file in enumerate(sorted(source.glob("*.npz"))):
        arrays = {**np.load(file), "stamp_ns": np.int64(index * 10**8 - 504_017)}
        np.savez(file, **arrays)
    opened = open_source("sweeps", source)
    assert opened.note == "stamps begin at -504017 ns: all are made 1 s later"
    assert [one.stamp_ns for one in opened.sweeps][:2] == [999_495_983, 1_099_495_983]


@pytest.mark.parametrize("flow", [False, True])
def test_sweeps_become_a_recording_with_truth(tmp_path, flow):
    out = tmp_path / "out"
    tiny_world.convert("sweeps", write_sweeps(tmp_path / "in", flow=flow), out)
    assert set(tiny_world.check_recording(out, "lidar").columns[0]["ring"]) == {3}


def npz(**changes):
    """A sweep of which some arrays differ."""
    stream = io.BytesIO()
    arrays = {"xyz": np.zeros((3, 3)), "stamp_ns": 5, "pose": np.eye(4), **changes}
    np.savez(stream, **{name: array for name, array in arrays.items() if array is not None})
    return stream.getvalue()


def box(**changes):
    """Changes a box of the second sweep."""

    def change(content):
        boxes = json.loads(content)
        boxes["1"][0] |= changes
        return json.dumps(boxes).encode()

    return change


READ, SECOND = "cannot be read: ", "cannot be read: sweep 1: "


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        *(("sweep_1.npz", length, READ) for length in (0, 50, 2000)),
        ("sweep_1.npz", npz(xyz=None), "has no array 'xyz'; it has stamp_ns, pose"),
        ("sweep_1.npz", npz(xyz=np.zeros((3, 3), complex)), "holds complex numbers"),
        ("sweep_1.npz", npz(xyz=np.zeros((3, 2))), r"xyz has shape \(3, 2\)"),
        ("sweep_1.npz", npz(xyz=np.full((3, 3), 1e300)), "overflow encountered in cast"),
        ("sweep_1.npz", npz(ring=np.full(3, np.nan)), "invalid value encountered in cast"),
        ("sweep_1.npz", npz(pose=np.diag([2.0, 2, 2, 1])), "pose is no rigid motion"),
        ("sweep_1.npz", npz(flow=np.zeros((2, 3))), r"flow has shape \(2, 3\)"),
        ("sweep_1.npz", npz(stamp_ns=np.array([None])), "Object arrays cannot be loaded"),
        ("boxes.json", box(size=[4, -2, 1]), rf"{SECOND}.*its size is \[4\.0, -2\.0, 1\.0\]"),
        ("boxes.json", box(yaw=math.nan), f"{SECOND}.*its pose is no rigid motion"),
        ("boxes.json", box(yaw="5"), f"{SECOND}must be real number"),
        ("boxes.json", box(center=5), f"{SECOND}cannot unpack"),
        ("boxes.json", box(track_id=["a"]), f"{SECOND}.*expected a text or an integer"),
        *(
            ("boxes.json", json.dumps(content).encode(), READ)
            for content in ([], 5, None, {"0": 5}, {"0": [5]}, {"0": [{}]}, {"x": []})
        ),
    ],
)
def test_damage_is_named(tmp_path, file, change, message):
    source = write_sweeps(tmp_path / "in")
    tiny_world.check_refused("sweeps", source, file, change, message)


# Real extracts lie beside the checkout.
DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[3] / "shared" / "data"))


def extract(name):
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


def test_a_real_sequence_keeps_its_flow(tmp_path):
    source = extract("kitti_0005")
    found = read("sweeps", source, tmp_path / "out", first=4, count=2)
    with np.load(source / "sweep_004.npz") as arrays:
        truth = found.truth[0]
        assert found.stamps[0] == arrays["stamp_ns"]
        # KITTI writes a ray without return as a point at the origin.
        returns = arrays["xyz"].any(axis=1)
        assert np.array_equal(found.xyz[0], arrays["xyz"][returns])
        assert np.array_equal(truth.flow[truth.valid], arrays["flow"][truth.valid])
        assert truth.valid[arrays["label_valid"]].all()
        assert truth.valid.mean() == pytest.approx(arrays["label_valid"].mean(), abs=0.02)
        dynamic = arrays["is_dynamic"] & truth.valid
        assert np.array_equal(truth.dynamic, dynamic)
        assert np.array_equal(truth.ground, arrays["is_ground"])
        assert {6, 8} <= set(truth.class_id[dynamic]) <= {0, 6, 8}
        np.testing.assert_allclose(found.poses[found.stamps[0]], arrays["pose"], atol=1e-9)


def test_real_boxes_give_the_flow_that_others_found():
    """The extract's flow was made with another program from the same boxes and poses."""
    sweeps = list(open_source("sweeps", extract("kitti_0005")).part(10, 2).sweeps)
    given = sweeps[0]
    # It took boxes enlarged by 0.2 m, and the ground in them.
    plain = replace(given, flow=None, dynamic=None, ground=np.zeros(len(given), bool))
    truth = sweep_truth(plain, sweeps[1], TruthSettings(0.2, unlabelled_static=True))
    assert truth.valid.all()
    moving = given.dynamic
    assert moving.sum() > 1000
    np.testing.assert_allclose(truth.flow[moving], given.flow[moving], atol=1e-6)
    same = np.linalg.norm(truth.flow - given.flow, axis=1) < 1e-6
    # Boxes that move too little count as parked there, and so get no flow of their own.
    assert same.mean() > 0.99
    assert (truth.dynamic != moving).mean() < 0.005


# Triplets and pairs.

TINY = [tiny_world.sweep(index) for index in range(3)]
FLOWS = [tiny_world.expected_flow(index, TINY[index].xyz, TINY[index].part) for index in range(2)]


def write_triplet(path, **arrays):
    points = {f"pc{index + 1}": one.xyz for index, one in enumerate(TINY)}
    np.savez(path, flow23=FLOWS[1].astype(np.float32), unknown=np.arange(5), **points, **arrays)
    return path


def test_a_triplet_has_flow_in_its_first_two_sweeps(tmp_path):
    path = write_triplet(tmp_path / "triplet.npz", flow12=FLOWS[0])
    found = read("triplets", path, tmp_path / "out")
    assert found.frames == {"lidar"}
    assert found.poses == {}
    for truth, xyz, tiny in zip(found.truth, found.xyz, TINY, strict=True):
        assert np.array_equal(xyz, tiny.xyz)
        assert not truth.ground.any()
    for truth, flow, tiny in zip(found.truth, FLOWS, TINY[:2], strict=False):
        assert truth.valid.all()
        np.testing.assert_allclose(truth.flow, flow, atol=1e-6)
        assert np.array_equal(truth.dynamic, tiny_world.moves(tiny.part))
    assert not found.truth[2].valid.any()


def test_flow_of_the_second_sweep_is_enough_and_extras_belong_to_it(tmp_path):
    number = np.arange(len(TINY[1].xyz))
    extras = {"label_valid": number % 2 == 0, "is_dynamic": number % 4 == 0}
    path = write_triplet(tmp_path / "triplet.npz", **extras)
    found = read("triplets", path, tmp_path / "out")
    assert np.array_equal(found.truth[1].valid, extras["label_valid"])
    assert np.array_equal(found.truth[1].dynamic, extras["is_dynamic"])
    assert not found.truth[0].valid.any()
    found = read("triplets", path, tmp_path / "all", unlabelled_static=True)
    assert found.truth[1].valid.all()


def test_files_of_a_folder_are_far_apart(tmp_path):
    (tmp_path / "in" / "log").mkdir(parents=True)
    write_triplet(tmp_path / "in" / "log" / "a.npz", flow12=FLOWS[0])
    np.savez(tmp_path / "in" / "second.npz", pc1=TINY[0].xyz, pc2=TINY[1].xyz, flow=FLOWS[0])
    found = read("triplets", tmp_path / "in", tmp_path / "out")
    assert np.diff(found.stamps).tolist() == [10**8, 10**8, 98 * 10**8, 10**8]
    assert [truth.valid.all() for truth in found.truth] == [True, True, False, True, False]


def test_triplets_that_do_not_fit_are_named(tmp_path):
    path, xyz = tmp_path / "triplet.npz", np.zeros((4, 3))
    for arrays, message in (
        ({"pc1": xyz}, "has no array 'pc2'; it has pc1"),
        ({"pc1": xyz, "pc2": xyz, "flow23": xyz}, r"has no flow \(flow\); it has flow23"),
        ({"pc1": xyz, "pc2": xyz, "flow": xyz[1:]}, r"flow has shape \(3, 3\), expected \(4, 3\)"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(DatasetError, match=rf"triplet\.npz: .*{message}"):
            read("triplets", path, tmp_path / "out")
    np.save(tmp_path / "single.npy", np.zeros(3))
    with pytest.raises(DatasetError, match="is a single array, expected an npz archive"):
        open_source("triplets", tmp_path / "single.npy")
