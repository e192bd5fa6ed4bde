# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.conversion import open_source
from mnsf_ros.errors import DatasetError

BOXES = "per_sweep_annotations_amodal/tracked_object_labels"
POSES = "poses/city_SE3_egovehicle"


def ply(xyz):
    fields = [(axis, "<f8") for axis in "xyz"]
    fields += [("intensity", "<f4"), ("laser_number", "u1")]
    rows = np.zeros(len(xyz), fields)
    for column, axis in enumerate("xyz"):
        rows[axis] = xyz[:, column]
    rows["intensity"], rows["laser_number"] = 12, 31
    header = f"ply\nformat binary_little_endian 1.0\ncomment none\nelement vertex {len(xyz)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += "property float intensity\nproperty uchar laser_number\n"
    return header.encode() + b"element face 0\nend_header\n" + rows.tobytes()


def label(track, pose):
    return {
        "center": dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
        "rotation": dict(zip("wxyz", tiny_world.quaternion(pose), strict=True)),
        **dict(zip(("length", "width", "height"), tiny_world.SIZE.tolist(), strict=True)),
        "track_label_uuid": track,
        "occlusion": 0,
        "label_class": {"name": "VEHICLE"} if track == "mover" else "VEHICLE",
    }


def write_log(folder):
    log = folder / "log"
    for sub in ("lidar", "poses", "per_sweep_annotations_amodal"):
        (log / sub).mkdir(parents=True)
    for index in range(tiny_world.NUM_SWEEPS):
        stamp = tiny_world.stamp_ns(index)
        (log / f"lidar/PC_{stamp}.ply").write_bytes(ply(tiny_world.sweep(index).xyz))
        pose = tiny_world.world_from_sweep(index)
        content = {"rotation": tiny_world.quaternion(pose), "translation": list(pose[:3, 3])}
        (log / f"{POSES}_{stamp}.json").write_text(json.dumps(content))
        labels = [label(track, box) for track, box in tiny_world.boxes(index).items()]
        (log / f"{BOXES}_{stamp}.json").write_text(json.dumps(labels))
    return log


def convert(log, out):
    return tiny_world.convert("argoverse1", log, out)


def test_a_log_becomes_a_recording_with_truth(tmp_path):
    out = convert(write_log(tmp_path), tmp_path / "out")
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


STAMP = tiny_world.stamp_ns(1)
SWEEP = f"lidar/PC_{STAMP}.ply"


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        (SWEEP, 900, "cannot be read: buffer is smaller"),
        (SWEEP, 40, "expected a little-endian PLY"),
        (SWEEP, (b"binary_little_endian", b"ascii"), "little-endian"),
        (SWEEP, (b"property uchar", b"property list a"), "list"),
        (SWEEP, (b"double x", b"double u"), "it has no 'x'"),
        (SWEEP, (b"vertex", b"camera"), "expected a little-endian PLY"),
        (f"{POSES}_{STAMP}.json", b"[]", "holds a list, expected a dict"),
        (f"{POSES}_{STAMP}.json", b"{}", "it has no 'rotation'"),
        (f"{POSES}_{STAMP}.json", (b'ion": [', b'ion": [NaN,'), "cannot reshape"),
        (f"{BOXES}_{STAMP}.json", b'[{"center": 1}]', "it has no 'rotation'"),
        (f"{BOXES}_{STAMP}.json", (b'"width": ', b'"width": -'), "its size is"),
    ],
)
def test_damage_is_named(tmp_path, file, change, message):
    tiny_world.check_refused("argoverse1", write_log(tmp_path), file, change, message)


def test_names_without_a_stamp_are_refused(tmp_path):
    log = write_log(tmp_path)
    (log / SWEEP).rename(log / "lidar/PC_one.ply")
    with pytest.raises(DatasetError, match=r"PC_one\.ply: 'one' in its name is no stamp"):
        open_source("argoverse1", log)
