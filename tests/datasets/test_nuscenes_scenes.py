# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import itertools
import json
import math
import os
from dataclasses import replace

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets import nuscenes
from mnsf_ros.datasets.formats import TruthSettings, open_source
from mnsf_ros.datasets.labelled_sweep import Box
from mnsf_ros.datasets.nuscenes import Keyframe, boxes_at
from mnsf_ros.errors import DatasetError

# The lidar looks to the left, as it does on the real vehicles, and the sweep is in its frame.
EGO_FROM_LIDAR = tiny_world.pose(0.9, 0.1, 1.8, -1.5)
MICROS = [tiny_world.stamp_ns(index) // 1000 for index in range(tiny_world.NUM_SWEEPS)]


def pose_entry(pose):
    half_yaw = math.atan2(pose[1, 0], pose[0, 0]) / 2
    rotation = [math.cos(half_yaw), 0.0, 0.0, math.sin(half_yaw)]
    return {"translation": pose[:3, 3].tolist(), "rotation": rotation}


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
        "sensor": [
            {"token": "cam", "channel": "CAM_FRONT"},
            {"token": "top", "channel": "LIDAR_TOP"},
        ],
        "calibrated_sensor": [
            {"token": "c1", "sensor_token": "cam", **pose_entry(np.eye(4))},
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
    write_data(tmp_path / "data")
    settings = TruthSettings(unlabelled_static=True)
    data = tmp_path / "data"
    tiny_world.convert("nuscenes", data, tmp_path / "out", settings, sequence="scene-1")
    found = tiny_world.read(tmp_path / "out")
    xyz = tiny_world.sweep(0).xyz
    own = on_own_vehicle(xyz)
    assert own.any()
    assert np.array_equal(found.xyz[0], xyz)
    assert not found.truth[0].valid[own].any()
    assert np.array_equal(found.truth[0].valid, ~own & (tiny_world.sweep(0).part != 5))


def test_the_folder_of_the_tables_will_do(tmp_path):
    write_data(tmp_path / "data")
    write_data(tmp_path / "data", version="v1.0-test")
    with pytest.raises(DatasetError, match=r"found v1\.0-mini, v1\.0-test"):
        open_source("nuscenes", tmp_path / "data")
    convert(tmp_path / "data" / "v1.0-mini", tmp_path / "out")


def test_a_split_without_annotations_has_no_valid_flow(tmp_path):
    tables = {**scene_tables(), "sample_annotation": []}
    found = tiny_world.read(convert(write_data(tmp_path / "data", tables), tmp_path / "out"))
    assert not any(truth.valid.any() for truth in found.truth)


def test_boxes_between_keyframes():
    def at(name, yaw, x):
        return {name: Box(tiny_world.pose(x, 0, 0, yaw), np.ones(3), 6, name)}

    # The shortest way from 170 to -170 degrees is over 180.
    keyframes = [
        Keyframe(100, at("both", math.radians(170), 1) | at("first", 0, 5)),
        Keyframe(200, at("both", math.radians(-170), 2) | at("last", 0, 6)),
    ]
    world_from_lidar = tiny_world.pose(0, 3, 0, 0)
    assert boxes_at(99, keyframes, world_from_lidar) is None
    assert boxes_at(201, keyframes, world_from_lidar) is None
    assert [box.track_id for box in boxes_at(100, keyframes, np.eye(4))] == ["both", "first"]
    assert [box.track_id for box in boxes_at(200, keyframes, np.eye(4))] == ["both", "last"]
    both, first, last = boxes_at(125, keyframes, world_from_lidar)
    assert (both.track_id, first.track_id, last.track_id) == ("both", None, None)
    expected = tiny_world.pose(1.25, -3, 0, math.radians(175))
    np.testing.assert_allclose(both.pose, expected, atol=1e-12)
    assert (first.pose[0, 3], last.pose[0, 3]) == (5, 6)


def test_a_scene_is_named(tmp_path):
    write_data(tmp_path)
    with pytest.raises(DatasetError, match="several scenes, name one; it has scene-1, scene-2"):
        convert(tmp_path, tmp_path / "out", None)
    with pytest.raises(DatasetError, match="no scene 'scene-3'"):
        convert(tmp_path, tmp_path / "out", "scene-3")
    with pytest.raises(DatasetError, match="has no lidar sweep of that scene"):
        convert(tmp_path, tmp_path / "out", "scene-2")
    with pytest.raises(DatasetError, match=r"expected one folder 'v1\.0-…' .* found none"):
        convert(tmp_path / "sweeps", tmp_path / "out")


TABLE = "v1.0-mini/"
SWEEP = "sweeps/LIDAR_TOP/1.bin"


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        (TABLE + "sample.json", lambda raw: raw[:-40], "the list has no end"),
        (TABLE + "sample.json", lambda raw: b"{}", "is no JSON list"),
        (TABLE + "sample.json", lambda raw: b"[1]", "'int' object is not subscriptable"),
        (TABLE + "sensor.json", lambda raw: b'[{"token": "a"}]', "it has no 'channel'"),
        (TABLE + "ego_pose.json", lambda raw: b"[]", "it has no 'e"),
        (TABLE + "ego_pose.json", lambda raw: raw.replace(b'ion": [', b'ion": [1,'), "quaternion"),
        (TABLE + "ego_pose.json", lambda raw: raw.replace(b'lation": [\n', b'lation": [NaN,'), ""),
        (TABLE + "sample_annotation.json", lambda raw: raw.replace(b"4.0,", b"-4.0,"), "size is"),
        (TABLE + "sample_annotation.json", lambda raw: raw.replace(b"parked", b"mover"), "twice"),
        (TABLE + "sample_data.json", lambda raw: raw.replace(b"sweeps/", b"../"), "leads out"),
        (SWEEP, lambda raw: raw[:-3], "is cut short"),
        (SWEEP, lambda raw: np.full(10, 1e38, "<f4").tobytes(), "coordinate 1e|invalid value"),
        (SWEEP, lambda raw: raw[:-4] + np.float32(np.nan).tobytes(), "invalid value encountered"),
    ],
)
def test_damage_is_named(tmp_path, name, change, message):
    path = write_data(tmp_path / "data") / name
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(DatasetError, match=rf"{path.name}: .*{message}"):
        convert(tmp_path / "data", tmp_path / "out")


def test_large_json_lists_are_read_in_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(nuscenes, "_CHUNK_CHARACTERS", 3)
    path = tmp_path / "rows.json"
    for rows in ([{"a": [1, {"b": "]}, {"}]}, {}, {"ü": None, "c": 1.5e-7}], []):
        path.write_text(json.dumps(rows, indent=2, ensure_ascii=False), encoding="utf-8")
        assert list(nuscenes.json_rows(path)) == rows


WRONG = [None, True, [], {}, "x", "1", math.nan, 10**400, [1e300] * 4]


@pytest.mark.parametrize("table", [name for name in scene_tables() if name != "category"])
def test_any_value_in_a_table_is_used_or_refused_in_one_line(tmp_path, table):
    data = write_data(tmp_path)
    real = np.concatenate([tiny_world.sweep(index).xyz for index in range(3)])
    for column, value in itertools.product(scene_tables()[table][-1], WRONG):
        rows = scene_tables()[table]
        rows[-1][column] = value
        (data / "v1.0-mini" / f"{table}.json").write_text(json.dumps(rows))
        try:
            sweeps = list(open_source("nuscenes", data, sequence="scene-1").sweeps)
        except DatasetError as error:
            assert "\n" not in str(error)  # noqa: PT017 - sweeps are as right
        else:
            assert all(np.isin(sweep.xyz, real).all() for sweep in sweeps)


@pytest.mark.parametrize("name", ["../../secret.bin", "sweeps/../../a", "/dev/zero", "pipe"])
def test_a_file_name_leads_to_a_file_of_the_data_set(tmp_path, name):
    tables = scene_tables()
    for row in tables["sample_data"]:
        row["filename"] = name
    data = write_data(tmp_path / "data", tables)
    os.mkfifo(data / "pipe")
    with pytest.raises(DatasetError, match=r"leads out of the data set|is not a regular file"):
        list(open_source("nuscenes", data, sequence="scene-1").sweeps)
