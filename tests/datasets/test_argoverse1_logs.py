# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import math

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.formats import open_source
from mnsf_ros.errors import DatasetError

BOXES = "per_sweep_annotations_amodal/tracked_object_labels"
POSES = "poses/city_SE3_egovehicle"


def ply(xyz, order="<"):
    fields = [(axis, f"{order}f8") for axis in "xyz"]
    fields += [("intensity", f"{order}f4"), ("laser_number", "u1")]
    rows = np.zeros(len(xyz), fields)
    for column, axis in enumerate("xyz"):
        rows[axis] = xyz[:, column]
    rows["intensity"], rows["laser_number"] = 12, 31
    name = "little" if order == "<" else "big"
    header = f"ply\nformat binary_{name}_endian 1.0\ncomment none\nelement vertex {len(xyz)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += "property float intensity\nproperty uchar laser_number\n"
    return header.encode() + b"element face 0\nend_header\n" + rows.tobytes()


def quaternion(pose):
    half_yaw = math.atan2(pose[1, 0], pose[0, 0]) / 2
    return {"w": math.cos(half_yaw), "x": 0.0, "y": 0.0, "z": math.sin(half_yaw)}


def label(track, pose):
    return {
        "center": dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
        "rotation": quaternion(pose),
        **dict(zip(("length", "width", "height"), tiny_world.SIZE.tolist(), strict=True)),
        "track_label_uuid": track,
        "occlusion": 0,
        "label_class": {"name": "VEHICLE"} if track == "mover" else "VEHICLE",
    }


def write_log(folder, order="<"):
    log = folder / "log"
    for sub in ("lidar", "poses", "per_sweep_annotations_amodal"):
        (log / sub).mkdir(parents=True)
    for index in range(tiny_world.NUM_SWEEPS):
        stamp = tiny_world.stamp_ns(index)
        (log / f"lidar/PC_{stamp}.ply").write_bytes(ply(tiny_world.sweep(index).xyz, order))
        pose = tiny_world.world_from_sweep(index)
        content = {"rotation": list(quaternion(pose).values()), "translation": list(pose[:3, 3])}
        (log / f"{POSES}_{stamp}.json").write_text(json.dumps(content))
        labels = [label(track, box) for track, box in tiny_world.boxes(index).items()]
        (log / f"{BOXES}_{stamp}.json").write_text(json.dumps(labels))
    return log


def convert(log, out):
    return tiny_world.convert("argoverse1", log, out)


@pytest.mark.parametrize("order", "<>")
def test_a_log_becomes_a_recording_with_truth(tmp_path, order):
    out = convert(write_log(tmp_path, order), tmp_path / "out")
    points = tiny_world.check_recording(out, "egovehicle").columns[0]
    assert (points["intensity"] == 12).all()
    assert (points["ring"] == 31).all()


def test_occluded_boxes_and_missing_labels(tmp_path):
    log = write_log(tmp_path)
    path = log / f"{BOXES}_{tiny_world.stamp_ns(0)}.json"
    labels = json.loads(path.read_text())
    labels[0]["occlusion"] = 100
    path.write_text(json.dumps(labels))
    (log / f"{BOXES}_{tiny_world.stamp_ns(1)}.json").unlink()
    found = tiny_world.read(convert(log, tmp_path / "out"))
    assert not found.truth[0].dynamic.any()
    assert [truth.valid.any() for truth in found.truth] == [True, False, False]


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("lidar/PC_{}.ply", lambda raw: raw[:900], "cannot be read: buffer is smaller"),
        ("lidar/PC_{}.ply", lambda raw: raw[:40], "expected a binary PLY file"),
        ("lidar/PC_{}.ply", lambda raw: raw.replace(b"binary_little_endian", b"ascii"), "binary"),
        ("lidar/PC_{}.ply", lambda raw: raw.replace(b"property uchar", b"property list a"), "list"),
        ("lidar/PC_{}.ply", lambda raw: raw.replace(b"double x", b"double u"), "it has no 'x'"),
        ("lidar/PC_{}.ply", lambda raw: raw.replace(b"vertex", b"camera"), "expected a binary PLY"),
        (POSES + "_{}.json", lambda raw: b"[]", "holds a list, expected a dict"),
        (POSES + "_{}.json", lambda raw: b"{}", "it has no 'rotation'"),
        (POSES + "_{}.json", lambda raw: raw.replace(b'ion": [', b'ion": [NaN,'), "quaternion"),
        (BOXES + "_{}.json", lambda raw: b'[{"center": 1}]', "it has no 'rotation'"),
        (BOXES + "_{}.json", lambda raw: raw.replace(b'"width": ', b'"width": -'), "its size is"),
    ],
)
def test_damage_is_named(tmp_path, name, change, message):
    log = write_log(tmp_path)
    path = log / name.format(tiny_world.stamp_ns(1))
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(DatasetError, match=rf"{path.name}: cannot be read: .*{message}|{message}"):
        convert(log, tmp_path / "out")


def test_names_without_a_stamp_are_refused(tmp_path):
    log = write_log(tmp_path)
    (log / f"lidar/PC_{tiny_world.stamp_ns(0)}.ply").rename(log / "lidar/PC_one.ply")
    with pytest.raises(DatasetError, match=r"PC_one\.ply: 'one' in its name is no stamp"):
        open_source("argoverse1", log)
