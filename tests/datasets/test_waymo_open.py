# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import itertools
import math
import zlib

import numpy as np
import pytest
import tiny_waymo
import tiny_world
from tiny_protobuf import crc32c, field, tf_record, varint

from mnsf_ros.datasets.formats import open_source
from mnsf_ros.datasets.recording_writer import write_recording
from mnsf_ros.datasets.waymo import (
    LaserCalibration,
    LaserReturns,
    shaped,
    waymo_sweep,
)
from mnsf_ros.datasets.waymo_records import parse
from mnsf_ros.errors import DatasetError


@pytest.fixture(scope="module")
def images():
    return tiny_waymo.images()


def convert(name, source, out, **options):
    write_recording(open_source(name, source, **options), out)
    return out


# The first edition: TFRecord files of messages.


def matrix(values):
    shape = field(1, list(values.shape))
    message = field(1, values.astype("<f4"), packed=True) + field(2, shape)
    return zlib.compress(message)


def frame(index, images, *, labels=True):
    context = field(1, "segment")
    lasers = b""
    for laser, one in zip(tiny_waymo.MOUNTS, images[index], strict=True):
        mount = field(1, tiny_waymo.MOUNTS[laser].ravel())
        angles = field(2, one.inclinations) + field(3, -9.0) + field(4, 9.0)
        context += field(3, field(1, laser) + angles + field(5, mount))
        returned = field(2, matrix(one.image)) + field(3, b"camera projection")
        returned += b"" if one.poses is None else field(4, matrix(one.poses))
        second = field(2, matrix(np.full((1, 1, 4), 7.0)))
        lasers += field(5, field(1, laser) + field(2, returned) + field(3, second))
    message = field(1, context) + field(2, tiny_world.stamp_ns(index) // 1000)
    message += field(3, field(1, tiny_world.world_from_sweep(index).ravel()))
    message += field(4, b"an image") + lasers
    if labels:
        message += field(6, [label(*item) for item in tiny_world.boxes(index).items()])
    return message + field(1000, 5)


def label(track, pose):
    x, y, z = pose[:3, 3].tolist()
    length, width, height = tiny_world.SIZE.tolist()
    box = [x, y, z, width, length, height, math.atan2(pose[1, 0], pose[0, 0])]
    message = b"".join(field(number, value) for number, value in enumerate(box, start=1))
    return field(1, message) + field(3, 1) + field(4, track)


def write_records(path, images, num_sweeps=tiny_world.NUM_SWEEPS, **options):
    pytest.importorskip("google.protobuf")
    indices = range(num_sweeps)
    path.write_bytes(b"".join(tf_record(frame(index, images, **options)) for index in indices))
    return path


def test_records_become_a_recording_with_truth(tmp_path, images):
    path = write_records(tmp_path / "segment.tfrecord", images)
    tiny_waymo.check(convert("waymo-v1", path, tmp_path / "out"), images)


def test_records_without_labels_have_no_valid_flow(tmp_path, images):
    path = write_records(tmp_path / "segment.tfrecord", images, labels=False)
    found = tiny_world.read(convert("waymo-v1", path, tmp_path / "out"))
    assert not any(truth.valid.any() for truth in found.truth)


def test_damaged_records_are_named(tmp_path, images):
    assert crc32c(b"123456789") == 0xE3069283
    path = write_records(tmp_path / "segment.tfrecord", images)
    whole = path.read_bytes()
    first = len(tf_record(frame(0, images)))
    flat = field(6, field(1, field(6, -1.0)))
    damages = {
        whole[: first + 5]: "cut short in the header of record 1",
        whole[: first + 500]: "cut short in record 1",
        whole[:-2]: "cut short in record 2",
        b"\0" + whole: "checksum of record 0 is wrong",
        whole[: first + 12] + b"\xff" * 2000 + whole[first + 2012 :]: "tfrecord: cannot be read",
        tf_record(frame(0, images)[:-9]): "tfrecord: cannot be read: record 0: .* cut short",
        tf_record(field(2, 5) + field(3, 5)): "cannot be read: record 0: cannot reshape",
        whole + tf_record(frame(1, images) + flat): "cannot be read: record 3: box of track",
        b"": r"segment\.tfrecord: is empty",
    }
    for damaged, message in damages.items():
        path.write_bytes(damaged)
        with pytest.raises(DatasetError, match=message):
            convert("waymo-v1", path, tmp_path / "out")


def test_fields_of_a_record():
    pytest.importorskip("google.protobuf")
    numbers = np.array([1.5, -2.5])
    angles = field(2, numbers) + field(2, numbers, packed=True)
    dims = field(1, [1, 2]) + field(1, varint(3) + varint(2**30))
    data = field(1, numbers.astype("<f4"), packed=True) + varint(1 << 3 | 5)
    calibration = parse("Calibration", field(1, -3) + angles + field(4, 0.5) + field(99, "x"))
    assert (calibration.name, calibration.low, calibration.high) == (-3, 0.0, 0.5)
    assert list(calibration.angles) == [1.5, -2.5] * 2
    message = parse("Matrix", data + np.float32(0.5).tobytes() + field(2, dims))
    assert list(message.data) == [1.5, -2.5, 0.5]
    assert list(message.shape.dims) == [1, 2, 3, 2**30]
    frame = parse("Frame", field(2, 2**40) + field(6, [field(4, "räder"), field(3, 4)]))
    assert [(label.id, label.type) for label in frame.labels] == [("räder", 0), ("", 4)]
    assert (frame.micros, list(frame.pose.values), list(frame.lasers)) == (2**40, [], [])


# The second edition: Parquet files.


def write_split(folder, images, segment="one", **changes):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    for name, rows in {**tables(images), **changes}.items():
        path = folder / name / f"{segment}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pa.Table.from_pylist(rows), path, row_group_size=2)
    return folder


def tables(images):
    rows = {name: [] for name in ("lidar", "lidar_pose", "vehicle_pose", "lidar_box")}
    for index, lasers in enumerate(images):
        key = {"key.frame_timestamp_micros": tiny_world.stamp_ns(index) // 1000}
        pose = tiny_world.world_from_sweep(index).ravel()
        rows["vehicle_pose"].append(
            {**key, "[VehiclePoseComponent].world_from_vehicle.transform": pose.tolist()}
        )
        rows["lidar_box"] += [key | box_row(*item) for item in tiny_world.boxes(index).items()]
        for laser, one in zip(tiny_waymo.MOUNTS, lasers, strict=True):
            laser_key = {**key, "key.laser_name": laser}
            rows["lidar"].append(laser_key | columns("LiDARComponent", one.image))
            if one.poses is not None:
                rows["lidar_pose"].append(laser_key | columns("LiDARPoseComponent", one.poses))
    rows["lidar_calibration"] = [
        calibration_row(laser, one.inclinations)
        for laser, one in zip(tiny_waymo.MOUNTS, images[0], strict=True)
    ]
    return rows


def columns(component, values):
    prefix = f"[{component}].range_image_return1"
    return {f"{prefix}.values": values.ravel(), f"{prefix}.shape": list(values.shape)}


def box_row(track, pose):
    box = dict(zip("xyz", pose[:3, 3].tolist(), strict=True))
    row = {f"[LiDARBoxComponent].box.center.{axis}": box[axis] for axis in "xyz"}
    sides = zip("xyz", tiny_world.SIZE.tolist(), strict=True)
    row |= {f"[LiDARBoxComponent].box.size.{axis}": side for axis, side in sides}
    heading = math.atan2(pose[1, 0], pose[0, 0])
    row |= {"[LiDARBoxComponent].box.heading": heading, "[LiDARBoxComponent].type": 1}
    return {**row, "key.laser_object_id": track}


def calibration_row(laser, angles):
    prefix = "[LiDARCalibrationComponent]"
    return {
        "key.laser_name": laser,
        f"{prefix}.extrinsic.transform": tiny_waymo.MOUNTS[laser].ravel().tolist(),
        f"{prefix}.beam_inclination.min": -0.4,
        f"{prefix}.beam_inclination.max": 0.1,
        f"{prefix}.beam_inclination.values": angles,
    }


def test_parquet_files_become_a_recording_with_truth(tmp_path, images):
    source = write_split(tmp_path / "validation", images)
    tiny_waymo.check(convert("waymo", source, tmp_path / "out"), images)


def test_one_of_several_segments_is_named(tmp_path, images):
    source = write_split(tmp_path, images[:2], "one")
    write_split(tmp_path, images[:2], "two")
    found = tiny_world.read(convert("waymo", source, tmp_path / "out", sequence="two"))
    assert len(found.stamps) == 2
    with pytest.raises(DatasetError, match="several segments, name one; it has one, two"):
        open_source("waymo", source)
    with pytest.raises(DatasetError, match="no segment 'three'; it has one, two"):
        open_source("waymo", source, sequence="three")


VEHICLE = "[VehiclePoseComponent].world_from_vehicle.transform"
BOX = "[LiDARBoxComponent].box"


def test_damaged_parquet_files_are_named(tmp_path, images):
    source, rows = write_split(tmp_path / "split", images[:2]), tables(images[:2])
    path = source / "lidar/one.parquet"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match=r"lidar/one\.parquet: cannot be read"):
        convert("waymo", source, tmp_path / "out")
    changes = {
        "are not in the order of 'key.frame": {
            name: rows[name][::-1] for name in ("lidar", "lidar_pose")
        },
        "has no pose in .*lidar_pose": {"lidar_pose": rows["lidar_pose"][:1]},
        r"has no column .*\[VehiclePoseComponent\]": {"vehicle_pose": [{"a": 1}]},
        "rows for 3 inclinations": {
            "lidar_calibration": [calibration_row(laser, [0.1] * 3) for laser in (1, 2)]
        },
        "cannot be read: it has no 2": {"lidar_calibration": [calibration_row(1, [0.1])]},
    }
    for message, change in changes.items():
        write_split(source, images[:2], **change)
        with pytest.raises(DatasetError, match=message):
            convert("waymo", source, tmp_path / "out")


@pytest.mark.parametrize(
    ("table", "change", "message"),
    [
        ("lidar_box", {f"{BOX}.size.x": None}, "its size is"),
        ("lidar_box", {f"{BOX}.heading": math.nan}, "its pose is no rigid motion"),
        ("lidar_box", {f"{BOX}.heading": None}, "must be real number"),
        ("vehicle_pose", {VEHICLE: [0.0] * 16}, "pose is no rigid motion"),
        ("vehicle_pose", {VEHICLE: [0.0] * 15}, "cannot reshape"),
    ],
)
def test_a_damaged_row_is_named_with_its_file_and_frame(tmp_path, images, table, change, message):
    rows = tables(images[:2])[table]
    rows[0] |= change
    source = write_split(tmp_path / "split", images[:2], **{table: rows})
    where = rf"{table}/one\.parquet: cannot be read: frame {tiny_world.stamp_ns(0) // 1000}: "
    with pytest.raises(DatasetError, match=f"{where}.*{message}"):
        convert("waymo", source, tmp_path / "out")


# Range images alone.


def test_evenly_spread_rows_and_zones_without_labels():
    level = LaserCalibration(np.eye(4), np.zeros(0), (-0.2, 0.2))
    image = np.full((2, 4, 4), -1, np.float32)
    image[:, :, 0], image[1, :, 3] = 10, 1
    sweep = waymo_sweep(5000, np.eye(4), [LaserReturns(1, image, None, level)], ())
    assert sweep.labelled.tolist() == [True] * 4 + [False] * 4
    for row, column in itertools.product(range(2), range(4)):
        x, y, z = sweep.xyz[4 * row + column]
        # The upper half of the angles comes first, and columns go clockwise from the back.
        assert math.asin(z / 10) == pytest.approx((0.1, -0.1)[row], abs=1e-6)
        assert math.degrees(math.atan2(y, x)) == pytest.approx(135 - 90 * column, abs=1e-4)


def test_a_frame_without_returns_is_an_empty_sweep():
    sweep = waymo_sweep(5000, np.eye(4), [], None)
    assert len(sweep) == 0
    empty = np.zeros((2, 4, 4), np.float32)
    poses = np.zeros((2, 4, 6), np.float32)
    level = LaserCalibration(np.eye(4), np.zeros(0), (-0.2, 0.2))
    assert len(waymo_sweep(5000, np.eye(4), [LaserReturns(1, empty, poses, level)], ())) == 0


def test_images_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"shape \[2, 2, 3\], expected \(H, W, 4\)"):
        shaped(np.zeros(12), [2, 2, 3], 4)
    with pytest.raises(ValueError, match="cannot reshape"):
        shaped(np.zeros(12), [2, 2, 4], 4)
