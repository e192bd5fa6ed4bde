# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest
import tiny_world

from mnsf_ros.errors import DatasetError

pa = pytest.importorskip("pyarrow")
feather = pytest.importorskip("pyarrow.feather")
LIDAR = "sensors/lidar"


def write_feather(path, columns, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(pa.table(columns), path, **options)


def pose_columns(poses):
    poses = np.array(poses).reshape(-1, 4, 4)
    half_yaw = np.arctan2(poses[:, 1, 0], poses[:, 0, 0]) / 2
    zeros = np.zeros(len(poses))
    # Quaternions may have either sign and need not be of length 1.
    return {
        "qw": -2 * np.cos(half_yaw), "qx": zeros, "qy": zeros, "qz": -2 * np.sin(half_yaw),
        "tx_m": poses[:, 0, 3], "ty_m": poses[:, 1, 3], "tz_m": poses[:, 2, 3],
    }  # fmt: skip


def write_log(folder, *, annotations=True):
    log = folder / "log"
    stamps = [tiny_world.stamp_ns(index) for index in range(tiny_world.NUM_SWEEPS)]
    for index, stamp in enumerate(stamps):
        xyz = tiny_world.sweep(index).xyz
        numbers = np.arange(len(xyz))
        columns = {axis: xyz[:, column] for column, axis in enumerate("xyz")}
        columns |= {
            "intensity": (numbers % 256).astype(np.uint8),
            "laser_number": (numbers % 64).astype(np.uint8),
            "offset_ns": (numbers * 1000).astype(np.int32),
        }
        write_feather(log / LIDAR / f"{stamp}.feather", columns, compression="zstd")
    # There are poses between those of the sweeps, too.
    poses = [tiny_world.world_from_sweep(index / 2) for index in range(5)]
    moments = [tiny_world.stamp_ns(0) + index * tiny_world.STEP_NS // 2 for index in range(5)]
    write_feather(
        log / "city_SE3_egovehicle.feather", {"timestamp_ns": moments, **pose_columns(poses)}
    )
    if annotations:
        write_annotations(log / "annotations.feather", stamps)
    return log


def write_annotations(path, stamps):
    found = [
        (stamp, track, pose)
        for index, stamp in enumerate(stamps)
        for track, pose in tiny_world.boxes(index).items()
    ]
    columns = {
        "timestamp_ns": [stamp for stamp, _, _ in found],
        "track_uuid": [track for _, track, _ in found],
        "category": pa.array(["REGULAR_VEHICLE"] * len(found)).dictionary_encode(),
        "num_interior_pts": [9] * len(found),
        **pose_columns([pose for _, _, pose in found]),
    }
    for name, side in zip(("length_m", "width_m", "height_m"), tiny_world.SIZE, strict=True):
        columns[name] = np.full(len(found), side)
    write_feather(path, columns)


def convert(log, out, **options):
    return tiny_world.convert("argoverse2", log, out, **options)


def test_a_log_becomes_a_recording_with_truth(tmp_path):
    out = convert(write_log(tmp_path), tmp_path / "out")
    points = tiny_world.check_recording(out, "egovehicle").columns[0]
    assert points["intensity"][300] == 300 % 256
    assert points["ring"][300] == 300 % 64
    assert points["time_offset"][300] == pytest.approx(3e-4)


def test_a_log_without_annotations_has_no_valid_flow(tmp_path):
    found = tiny_world.read(convert(write_log(tmp_path, annotations=False), tmp_path / "out"))
    assert not any(truth.valid.any() for truth in found.truth)


def write_labels(folder, layout, category=19):
    for index in range(tiny_world.NUM_SWEEPS - 1):
        tiny = tiny_world.sweep(index)
        flow = tiny_world.expected_flow(index, tiny.xyz, tiny.part).astype(np.float16)
        columns = {f"flow_t{axis}_m": flow[:, column] for column, axis in enumerate("xyz")}
        valid, is_car = tiny.part != tiny_world.GONE, np.isin(tiny.part, (1, 2, 4, 5))
        if layout == "stamps":
            moving = np.isin(tiny.part, (tiny_world.MOVER, tiny_world.MARGIN))
            columns |= {"is_valid": valid, "is_dynamic": moving}
            columns["category_indices"] = np.where(is_car, category, 0).astype(np.uint8)
            name = tiny_world.stamp_ns(index)
        else:
            columns |= {"valid": valid, "classes_0": np.where(is_car, 18, -1).astype(np.int8)}
            name = f"{index:010d}"
        write_feather(folder / f"{name}.feather", columns)
    return folder


@pytest.mark.parametrize("layout", ["stamps", "counted"])
def test_flow_labels_replace_the_boxes(tmp_path, layout):
    labels = write_labels(tmp_path / "labels", layout)
    log = write_log(tmp_path, annotations=False)
    # Labels are in half precision.
    tiny_world.check_recording(
        convert(log, tmp_path / "out", labels=labels), "egovehicle", tolerance=2e-3
    )


@pytest.mark.parametrize("first", [0, 1])
def test_the_first_sweeps_alone_may_have_labels(tmp_path, first):
    written = write_labels(tmp_path / "written", "counted")
    labels = tmp_path / "labels"
    labels.mkdir()
    (written / f"{0:010d}.feather").rename(labels / f"{first:010d}.feather")
    found = tiny_world.read(convert(write_log(tmp_path), tmp_path / "out", labels=labels))
    assert [truth.valid.any() for truth in found.truth] == [True, False, False]


@pytest.mark.parametrize("names", [[5, 6], [0, 2], [0, 1, 2], [tiny_world.STEP_NS]])
def test_other_names_of_labels_are_refused(tmp_path, names):
    log = write_log(tmp_path)
    for name in names:
        write_feather(tmp_path / "labels" / f"{name}.feather", {"a": [1]})
    with pytest.raises(DatasetError, match=rf"has the stamp of no sweep, and {len(names)} files"):
        convert(log, tmp_path / "out", labels=tmp_path / "labels")


def test_labels_that_do_not_fit_are_refused(tmp_path):
    log = write_log(tmp_path)
    labels = write_labels(tmp_path / "labels", "stamps", category=31)
    path = labels / f"{tiny_world.stamp_ns(0)}.feather"
    with pytest.raises(DatasetError, match=rf"{path.name}: cannot be read: category number 31"):
        convert(log, tmp_path / "out", labels=labels)
    feather.write_feather(feather.read_table(path).slice(7), path)
    num_points = len(tiny_world.sweep(0).xyz)
    with pytest.raises(DatasetError, match=rf"has {num_points - 7} rows for {num_points} points"):
        convert(log, tmp_path / "out", labels=labels)


@pytest.mark.parametrize(
    ("file", "column", "value", "message"),
    [
        ("annotations", "tx_m", math.nan, "sweep of stamp {}: .*its pose is no rigid motion"),
        ("annotations", "qw", math.nan, "sweep of stamp {}: .*(rotation|rigid|norm)"),
        ("annotations", "length_m", -4.0, "sweep of stamp {}: .*its size is"),
        ("annotations", "height_m", None, "sweep of stamp {}: .*its size is"),
        ("city_SE3_egovehicle", "tz_m", math.inf, "pose of stamp {}: pose is no rigid motion"),
    ],
)
def test_a_damaged_row_is_named_with_its_sweep(tmp_path, file, column, value, message):
    path = write_log(tmp_path) / f"{file}.feather"
    rows = feather.read_table(path).to_pylist()
    stamp = tiny_world.stamp_ns(1)
    next(row for row in rows if row["timestamp_ns"] == stamp)[column] = value
    feather.write_feather(pa.Table.from_pylist(rows), path)
    where = rf"{path.name}: cannot be read: "
    with pytest.raises(DatasetError, match=where + message.format(stamp)):
        convert(path.parent, tmp_path / "out")


def test_damaged_missing_and_misnamed_files_are_named(tmp_path):
    log = write_log(tmp_path)
    last = log / LIDAR / f"{tiny_world.stamp_ns(2)}.feather"
    whole = last.read_bytes()
    for keep in (0, 7, 1000, len(whole) - 10):
        last.write_bytes(whole[:keep])
        with pytest.raises(DatasetError, match=rf"{last.name}: cannot be read"):
            convert(log, tmp_path / "bag")
    write_feather(last, {"x": [1.0], "y": [1.0]})
    with pytest.raises(DatasetError, match=r"has no column z, intensity, laser_number, offset_ns"):
        convert(log, tmp_path / "bag")
    stamp = tiny_world.stamp_ns(1)
    (log / LIDAR / f"{stamp}.feather").rename(log / LIDAR / f"{stamp + 1}.feather")
    with pytest.raises(DatasetError, match=f"egovehicle.feather: has no pose of stamp {stamp + 1}"):
        convert(log, tmp_path / "bag")
    (log / "city_SE3_egovehicle.feather").unlink()
    with pytest.raises(DatasetError, match=r"city_SE3_egovehicle\.feather: no such file"):
        convert(log, tmp_path / "bag")
