# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import replace

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.conversion import open_source
from mnsf_ros.datasets.pseudo_ground_truth import TruthSettings
from mnsf_ros.errors import DatasetError

# The lidar looks to the left, as it does on the real vehicles, and the sweep is in its frame.
EGO_FROM_LIDAR = tiny_world.pose(0.9, 0.1, 1.8, -1.5)
MICROS = [tiny_world.stamp_ns(index) // 1000 for index in range(tiny_world.NUM_SWEEPS)]


def pose_entry(pose):
    return {"translation": pose[:3, 3].tolist(), "rotation": tiny_world.quaternion(pose)}


def scene_tables():
    """Two scenes; of the first, sweeps 0 and 2 are annotated, 1 is between them."""
    length, width, height = tiny_world.SIZE.tolist()
    tables = {
        "scene": [{"token": "s1", "name": "scene-1"}, {"token": "s2", "name": "scene-2"}],
        "sample": [
            {"token": "k0", "timestamp": MICROS[0], "scene_token": "s1"},
            {"token": "k2", "timestamp": MICROS[2], "scene_token": "s1"},
            {"token": "other", "timestamp": 7, "scene_token": "s2"},
        ],
        "sensor": [{"token": "c", "channel": "CAM"}, {"token": "top", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [
            {"token": "c1", "sensor_token": "c", **pose_entry(np.eye(4))},
            {"token": "l1", "sensor_token": "top", **pose_entry(EGO_FROM_LIDAR)},
        ],
        "category": [{"token": "cat", "name": "vehicle.car"}],
        "instance": [
            {"token": track, "category_token": "cat"} for track in ("mover", "parked", "gone")
        ],
        "sample_annotation": [
            {
                "sample_token": f"k{index}",
                "instance_token": track,
                "size": [width, length, height],
                **pose_entry(tiny_world.world_from_box(track, index)),
            }
            for index in (2, 0)
            for track in tiny_world.boxes(index)
        ],
        "sample_data": [],
        "ego_pose": [{"token": "e9", **pose_entry(np.eye(4))}],
    }
    for index in (2, 0, 1):
        pose = tiny_world.world_from_sweep(index) @ np.linalg.inv(EGO_FROM_LIDAR)
        tables["ego_pose"].append({"token": f"e{index}", **pose_entry(pose)})
        for sensor, folder in (("c1", "CAM"), ("l1", "LIDAR_TOP")):
            tables["sample_data"].append(
                {
                    "sample_token": "k0" if index == 0 else "k2",
                    "ego_pose_token": f"e{index}",
                    "calibrated_sensor_token": sensor,
                    "timestamp": MICROS[index],
                    "filename": f"sweeps/{folder}/{index}.bin",
                }
            )
    return tables


def write_data(folder, tables=None, version="v1.0-mini"):
    (folder / version).mkdir(parents=True, exist_ok=True)
    (folder / "sweeps/LIDAR_TOP").mkdir(parents=True, exist_ok=True)
    for name, rows in (tables or scene_tables()).items():
        (folder / version / f"{name}.json").write_text(json.dumps(rows, indent=1))
    for index in range(tiny_world.NUM_SWEEPS):
        xyz = tiny_world.sweep(index).xyz
        extra = np.tile([33.0, 17.0], (len(xyz), 1))
        rows = np.hstack([xyz, extra]).astype("<f4")
        rows.tofile(folder / f"sweeps/LIDAR_TOP/{index}.bin")
    return folder


def convert(source, out, sequence="scene-1"):
    return tiny_world.convert("nuscenes", source, out, sequence=sequence)


def test_a_scene_becomes_a_recording_with_truth(tmp_path):
    out = convert(write_data(tmp_path / "data"), tmp_path / "out")
    found = tiny_world.read(out)
    assert found.stamps == [micros * 1000 for micros in MICROS]
    assert found.frames == {"lidar_top"}
    for index in range(tiny_world.NUM_SWEEPS):
        tiny, truth = tiny_world.sweep(index), found.truth[index]
        other = ~on_own_vehicle(tiny.xyz)
        rows = ("flow", "valid", "dynamic", "ground", "class_id")
        kept = replace(truth, **{name: getattr(truth, name)[other] for name in rows})
        tiny_world.check_truth(kept, index, tiny.xyz[other], tiny.part[other])
        pose = found.poses[found.stamps[index]]
        np.testing.assert_allclose(pose, tiny_world.world_from_sweep(index), atol=1e-9)
    assert set(found.columns[0]["intensity"]) == {33}
    assert set(found.columns[0]["ring"]) == {17}


def on_own_vehicle(xyz):
    """Where OpenSceneFlow removes points: x is to the right of the vehicle, y to its front."""
    return (np.abs(xyz[:, 0]) < 0.865) & (np.abs(xyz[:, 1]) < 2.042)


def test_points_of_the_own_vehicle_are_there_but_not_valid(tmp_path):
    settings = TruthSettings(unlabelled_static=True)
    data, out = write_data(tmp_path / "data"), tmp_path / "out"
    found = tiny_world.read(tiny_world.convert("nuscenes", data, out, settings, sequence="scene-1"))
    tiny = tiny_world.sweep(0)
    own = on_own_vehicle(tiny.xyz)
    assert own.any()
    assert np.array_equal(found.xyz[0], tiny.xyz)
    assert np.array_equal(found.truth[0].valid, ~own & (tiny.part != tiny_world.GONE))


def test_a_split_without_annotations_has_no_valid_flow(tmp_path):
    tables = {**scene_tables(), "sample_annotation": []}
    found = tiny_world.read(convert(write_data(tmp_path / "data", tables), tmp_path / "out"))
    assert not any(truth.valid.any() for truth in found.truth)


def test_sweeps_before_and_after_the_keyframes_have_no_boxes(tmp_path):
    tables = scene_tables()
    for sample, micros in zip(tables["sample"], (MICROS[1], MICROS[1] + 1), strict=False):
        sample["timestamp"] = micros
    source = open_source("nuscenes", write_data(tmp_path, tables), sequence="scene-1")
    assert [sweep.boxes is None for sweep in source.sweeps] == [True, False, True]


def test_a_scene_is_named(tmp_path):
    write_data(tmp_path)
    for source, scene, message in (
        (tmp_path, None, "several scenes, name one; it has scene-1, scene-2"),
        (tmp_path, "scene-3", "no scene 'scene-3'"),
        # The folder of the tables will do.
        (tmp_path / "v1.0-mini", "scene-2", "has no lidar sweep of that scene"),
        (tmp_path / "sweeps", "scene-1", r"expected one folder 'v1\.0-…' .* found none"),
    ):
        with pytest.raises(DatasetError, match=message):
            open_source("nuscenes", source, sequence=scene)
    write_data(tmp_path, version="v1.0-test")
    with pytest.raises(DatasetError, match=r"found v1\.0-mini, v1\.0-test"):
        open_source("nuscenes", tmp_path, sequence="scene-1")


TABLE = "v1.0-mini/"
SWEEP = "sweeps/LIDAR_TOP/1.bin"
NAN_ROW = np.full(5, np.nan, "<f4").tobytes()


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        (TABLE + "sample.json", -40, "Unterminated string|Expecting"),
        (TABLE + "sample.json", b"{}", "is no JSON list"),
        (TABLE + "sample.json", b"[1]", "'int' object is not subscriptable"),
        (TABLE + "sensor.json", b'[{"token": "a"}]', "it has no 'channel'"),
        (TABLE + "ego_pose.json", b"[]", "it has no 'e"),
        (TABLE + "ego_pose.json", (b'ion": [', b'ion": [1,'), "cannot reshape"),
        (TABLE + "ego_pose.json", (b'lation": [\n', b'lation": [NaN,'), ""),
        (TABLE + "sample_annotation.json", (b"4.0,", b"-4.0,"), "size is"),
        (TABLE + "sample_annotation.json", (b"parked", b"mover"), "twice"),
        (TABLE + "sample_data.json", (b"sweeps/", b"../"), "leads out of the data set"),
        (TABLE + "sample_data.json", (b"sweeps/", b"/dev/"), "leads out of the data set"),
        (SWEEP, -3, "is cut short"),
        (SWEEP, np.full(10, 1e38, "<f4").tobytes(), "coordinate 1e|invalid value"),
        (SWEEP, NAN_ROW, "invalid value encountered"),
    ],
)
def test_damage_is_named(tmp_path, file, change, message):
    data = write_data(tmp_path / "data")
    tiny_world.check_refused("nuscenes", data, file, change, message, sequence="scene-1")
