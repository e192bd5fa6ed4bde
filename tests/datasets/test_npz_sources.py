# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.formats import TruthSettings, open_source
from mnsf_ros.datasets.pseudo_ground_truth import sweep_truth
from mnsf_ros.datasets.recording_writer import write_recording
from mnsf_ros.errors import DatasetError


def convert(name, source, out, first=0, count=None, **settings):
    opened = open_source(name, source).part(first, count)
    write_recording(opened, out, TruthSettings(**settings))
    return out


# Sweeps.


def write_sweeps(folder, *, flow=False, boxes=True):
    folder.mkdir()
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
    if boxes:
        content = {
            str(index): [entry(*item) for item in tiny_world.boxes(index).items()]
            for index in range(tiny_world.NUM_SWEEPS)
        }
        (folder / "boxes.json").write_text(json.dumps(content))
    return folder


def entry(track, pose):
    return {
        "track_id": track,
        "cls": "Van",
        "center": pose[:3, 3].tolist(),
        "size": tiny_world.SIZE.tolist(),
        "yaw": math.atan2(pose[1, 0], pose[0, 0]),
        "occluded": 0,
    }


@pytest.mark.parametrize("flow", [False, True])
def test_sweeps_become_a_recording_with_truth(tmp_path, flow):
    source = write_sweeps(tmp_path / "in", flow=flow)
    found = tiny_world.check_recording(convert("sweeps", source, tmp_path / "out"), "lidar")
    assert set(found.columns[0]["ring"]) == {3}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"xyz": np.zeros((3, 3), complex)}, r"holds complex numbers \(complex128\)"),
        ({"xyz": np.zeros((3, 2))}, r"xyz has shape \(3, 2\)"),
        ({"xyz": np.full((3, 3), 1e300)}, "overflow encountered in cast"),
        ({"ring": np.full(3, np.nan)}, "invalid value encountered in cast"),
        ({"pose": np.diag([2.0, 2, 2, 1])}, "pose is no rigid motion"),
        ({"flow": np.zeros((2, 3))}, r"flow has shape \(2, 3\)"),
        ({"stamp_ns": np.array([None])}, "Object arrays cannot be loaded"),
    ],
)
def test_arrays_that_cannot_be_used_are_named(tmp_path, arrays, message):
    usable = {"xyz": np.zeros((3, 3)), "stamp_ns": 5, "pose": np.eye(4)}
    np.savez(tmp_path / "one.npz", **(usable | arrays))
    with pytest.raises(DatasetError, match=rf"one\.npz: cannot be read: .*{message}"):
        convert("sweeps", tmp_path, tmp_path / "out")


def test_damaged_archives_are_named(tmp_path):
    source = write_sweeps(tmp_path / "in")
    path = source / "sweep_1.npz"
    whole = path.read_bytes()
    for keep in (0, 50, len(whole) // 2):
        path.write_bytes(whole[:keep])
        with pytest.raises(DatasetError, match=r"sweep_1\.npz: cannot be read"):
            convert("sweeps", source, tmp_path / "out")
    np.savez(path, points=np.zeros((3, 3)), stamp_ns=1)
    with pytest.raises(DatasetError, match="has no array 'xyz'; it has points, stamp_ns"):
        convert("sweeps", source, tmp_path / "out")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": [4, -2, 1]}, r"its size is \[4\.0, -2\.0, 1\.0\], expected 3 above 0"),
        ({"yaw": math.nan}, "its pose is no rigid motion"),
        ({"yaw": "5"}, "must be real number"),
        ({"center": 5}, "cannot unpack"),
        ({"track_id": ["a"]}, "expected a text or an integer"),
    ],
)
def test_a_damaged_box_is_named_with_its_sweep(tmp_path, change, message):
    source = write_sweeps(tmp_path / "in")
    boxes = json.loads((source / "boxes.json").read_text())
    boxes["1"][0] |= change
    (source / "boxes.json").write_text(json.dumps(boxes))
    with pytest.raises(DatasetError, match=rf"boxes\.json: cannot be read: sweep 1: .*{message}"):
        open_source("sweeps", source)


@pytest.mark.parametrize("content", [[], 5, None, {"0": 5}, {"0": [5]}, {"0": [{}]}, {"x": []}])
def test_boxes_of_another_structure_are_refused(tmp_path, content):
    source = write_sweeps(tmp_path / "in")
    (source / "boxes.json").write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=r"boxes\.json: cannot be read"):
        open_source("sweeps", source)


# Real extracts lie beside the checkout.
DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[3] / "shared" / "data"))


def extract(name):
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


def test_a_real_sequence_keeps_its_flow(tmp_path):
    source = extract("kitti_0005")
    out = convert("sweeps", source, tmp_path / "out", first=4, count=2)
    found = tiny_world.read(out)
    with np.load(source / "sweep_004.npz") as arrays:
        truth = found.truth[0]
        assert found.stamps[0] == arrays["stamp_ns"]
        assert np.array_equal(found.xyz[0], arrays["xyz"])
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
    given = sweeps[0].given
    # It took boxes enlarged by 0.2 m, and the ground in them.
    plain = replace(sweeps[0], given=None, ground=np.zeros(len(sweeps[0]), bool))
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


def write_triplet(path, *, extras=False, forward=True):
    tiny = [tiny_world.sweep(index) for index in range(3)]
    arrays = {f"pc{index + 1}": one.xyz for index, one in enumerate(tiny)}
    flows = [tiny_world.expected_flow(index, tiny[index].xyz, tiny[index].part) for index in (0, 1)]
    arrays["flow23"] = flows[1].astype(np.float32)
    if forward:
        arrays["flow12"] = flows[0].astype(np.float32)
    if extras:
        arrays["label_valid"] = np.arange(len(tiny[1].xyz)) % 2 == 0
        arrays["is_dynamic"] = np.arange(len(tiny[1].xyz)) % 4 == 0
    np.savez(path, mask1_tracks_flow=np.arange(5), **arrays)
    return path


def test_a_triplet_has_flow_in_its_first_two_sweeps(tmp_path):
    path = write_triplet(tmp_path / "triplet.npz")
    found = tiny_world.read(convert("triplets", path, tmp_path / "out"))
    assert found.frames == {"lidar"}
    assert found.poses == {}
    for index, truth in enumerate(found.truth):
        tiny = tiny_world.sweep(index)
        assert np.array_equal(found.xyz[index], tiny.xyz)
        if index < 2:
            assert truth.valid.all()
            expected = tiny_world.expected_flow(index, tiny.xyz, tiny.part)
            np.testing.assert_allclose(truth.flow, expected, atol=1e-6)
            moving = np.isin(tiny.part, (tiny_world.MOVER, tiny_world.MARGIN))
            assert np.array_equal(truth.dynamic, moving)
        assert not truth.ground.any()
    assert not found.truth[2].valid.any()


def test_flow_of_the_second_sweep_is_enough_and_extras_belong_to_it(tmp_path):
    path = write_triplet(tmp_path / "triplet.npz", extras=True, forward=False)
    found = tiny_world.read(convert("triplets", path, tmp_path / "out"))
    number = np.arange(len(found.xyz[1]))
    assert np.array_equal(found.truth[1].valid, number % 2 == 0)
    assert np.array_equal(found.truth[1].dynamic, number % 4 == 0)
    assert not found.truth[0].valid.any()
    found = tiny_world.read(convert("triplets", path, tmp_path / "all", unlabelled_static=True))
    assert found.truth[1].valid.all()


def test_files_of_a_folder_are_far_apart(tmp_path):
    (tmp_path / "in" / "log").mkdir(parents=True)
    write_triplet(tmp_path / "in" / "log" / "a.npz")
    tiny = tiny_world.sweep(0)
    flow = tiny_world.expected_flow(0, tiny.xyz, tiny.part)
    np.savez(tmp_path / "in" / "second.npz", pc1=tiny.xyz, pc2=tiny_world.sweep(1).xyz, flow=flow)
    found = tiny_world.read(convert("triplets", tmp_path / "in", tmp_path / "out"))
    assert np.diff(found.stamps).tolist() == [10**8, 10**8, 98 * 10**8, 10**8]
    assert [truth.valid.all() for truth in found.truth] == [True, True, False, True, False]


def test_real_triplets(tmp_path):
    source = extract("triplets")
    found = tiny_world.read(convert("triplets", source, tmp_path / "out.mcap"))
    files = sorted(source.glob("*.npz"))
    assert len(found.stamps) == 3 * len(files)
    with np.load(files[1]) as arrays:
        truth = found.truth[4]
        assert np.array_equal(found.xyz[4], arrays["pc2"])
        assert np.array_equal(truth.valid, arrays["label_valid"])
        assert np.array_equal(truth.flow[truth.valid], arrays["flow23"][truth.valid])
        assert np.array_equal(truth.dynamic, arrays["is_dynamic"] & arrays["label_valid"])


def test_triplets_that_do_not_fit_are_named(tmp_path):
    path, xyz = tmp_path / "triplet.npz", np.zeros((4, 3))
    for arrays, message in (
        ({"pc1": xyz}, "has no array 'pc2'; it has pc1"),
        ({"pc1": xyz, "pc2": xyz, "flow23": xyz}, r"has no flow \(flow\); it has flow23"),
        (
            {"pc1": xyz, "pc2": xyz, "flow": xyz[1:]},
            "expected that of pc1",
        ),
    ):
        np.savez(path, **arrays)
        with pytest.raises(DatasetError, match=rf"triplet\.npz: .*{message}"):
            convert("triplets", path, tmp_path / "out")
    np.save(tmp_path / "single.npy", np.zeros(3))
    with pytest.raises(DatasetError, match="is a single array, expected an npz archive"):
        open_source("triplets", tmp_path / "single.npy")
