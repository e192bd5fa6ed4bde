# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import io
import math

import numpy as np
import pytest
import tiny_world

pa = pytest.importorskip("pyarrow")
feather = pytest.importorskip("pyarrow.feather")
LIDAR = "sensors/lidar"


def write_feather(path, columns, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(pa.table(columns), path, **options)


def pose_columns(poses):
    # Quaternions may have either sign and need not be of length 1.
    rows = [[*(-2 * np.array(tiny_world.quaternion(pose))), *pose[:3, 3]] for pose in poses]
    names = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
    return dict(zip(names, np.transpose(rows), strict=True))


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


def convert(log, out):
    return tiny_world.convert("argoverse2", log, out)


def test_a_log_becomes_a_recording_with_truth(tmp_path):
    out = convert(write_log(tmp_path), tmp_path / "out")
    points = tiny_world.check_recording(out, "egovehicle").columns[0]
    assert points["intensity"][300] == 300 % 256
    assert points["ring"][300] == 300 % 64
    assert points["time_offset"][300] == pytest.approx(3e-4)


def test_a_log_without_annotations_has_no_valid_flow(tmp_path):
    found = tiny_world.read(convert(write_log(tmp_path, annotations=False), tmp_path / "out"))
    assert not any(truth.valid.any() for truth in found.truth)


def test_boxes_without_points_own_none(tmp_path):
    path = write_log(tmp_path) / "annotations.feather"
    table = feather.read_table(path)
    place = table.column_names.index("num_interior_pts")
    empty = table.set_column(place, "num_interior_pts", [[0] * len(table)])
    path.write_bytes(feather_bytes(empty))
    found = tiny_world.read(convert(path.parent, tmp_path / "out"))
    assert not any(truth.class_id.any() for truth in found.truth)


STAMP = tiny_world.stamp_ns(1)


def with_value(column, value):
    """Puts a value into the row of a sweep."""

    def change(content):
        rows = feather.read_table(pa.BufferReader(content)).to_pylist()
        next(row for row in rows if row["timestamp_ns"] == STAMP)[column] = value
        return feather_bytes(pa.Table.from_pylist(rows))

    return change


def feather_bytes(table):
    stream = io.BytesIO()
    feather.write_feather(table, stream)
    return stream.getvalue()


ROW = f"cannot be read: sweep of stamp {STAMP}: "
XY = feather_bytes(pa.table({"x": [1.0], "y": [1.0]}))


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("annotations", with_value("tx_m", math.nan), f"{ROW}.*its pose is no rigid motion"),
        ("annotations", with_value("qw", math.nan), f"{ROW}.*(rotation|rigid|norm)"),
        ("annotations", with_value("length_m", -4.0), f"{ROW}.*its size is"),
        ("annotations", with_value("height_m", None), f"{ROW}.*its size is"),
        ("city_SE3_egovehicle", with_value("tz_m", math.inf), f"pose of stamp {STAMP}: pose is no"),
        ("city_SE3_egovehicle", with_value("timestamp_ns", 5), f"has no pose of stamp {STAMP}"),
        ("city_SE3_egovehicle", None, "no such file"),
        (f"{LIDAR}/{STAMP}", XY, "has no column z, intensity, laser_number, offset_ns"),
        *((f"{LIDAR}/{STAMP}", length, "cannot be read") for length in (0, 7, 1000, -10)),
    ],
)
def test_damage_is_named(tmp_path, file, change, message):
    log = write_log(tmp_path)
    tiny_world.check_refused("argoverse2", log, f"{file}.feather", change, message)
