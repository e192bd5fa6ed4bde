# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Waymo Open: range images of two lidars in Parquet files."""

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
import tiny_world
from scipy.spatial.transform import Rotation

from mnsf_ros.datasets.conversion import open_source
from mnsf_ros.errors import DatasetError

HEIGHT, WIDTH = 5, 12
# From the lowest row up.
ANGLES = np.array([-0.3, -0.2, -0.12, -0.05, 0.04])
# The lidar on the roof is turned; the one at the front is tilted, too.
MOUNTS = {1: tiny_world.pose(1.4, 0.0, 2.2, 2.6), 2: tiny_world.pose(4.0, 0.1, 0.7, 0.05)}
MOUNTS[2][:3, :3] = MOUNTS[2][:3, :3] @ Rotation.from_euler("y", 0.1).as_matrix()
VEHICLE = "[VehiclePoseComponent].world_from_vehicle.transform"
BOX = "[LiDARBoxComponent].box"


class Image(NamedTuple):
    """A range image (H, W, 4), poses (H, W, 6) or None, and its points (N, 3) in the vehicle."""

    image: np.ndarray
    poses: np.ndarray | None
    points: np.ndarray


def made_image(index, laser):
    rng = np.random.default_rng(10 * index + laser)
    image = np.full((HEIGHT, WIDTH, 4), -1, np.float32)
    hit = rng.random((HEIGHT, WIDTH)) < 0.7
    image[hit, 0] = rng.uniform(3, 40, hit.sum())
    image[hit, 1:] = 0.5, 0.25 * laser, -1
    poses = pixel_poses(index) if laser == 1 else None
    pixels = zip(*np.nonzero(hit), strict=True)
    points = [point_of(index, laser, image, poses, *pixel) for pixel in pixels]
    return Image(image, poses, np.array(points))


def pixel_poses(index):
    """Roll, pitch, yaw, x, y, z of the vehicle in the world while each column was measured."""
    x, y, z = tiny_world.world_from_sweep(index)[:3, 3]
    late = np.arange(WIDTH) / WIDTH - 0.5
    columns = np.tile(np.float32([0.01, -0.02, 0, x, y, z + 0.05]), (WIDTH, 1))
    columns[:, 2] += 0.03 * late
    columns[:, 3] += 0.8 * late
    return np.broadcast_to(columns, (HEIGHT, WIDTH, 6))


def point_of(index, laser, image, poses, row, column):
    """The place of one pixel, by rotation matrices."""
    mount, distance = MOUNTS[laser], float(image[row, column, 0])
    azimuth = math.pi - (column + 0.5) / WIDTH * 2 * math.pi - tiny_world.yaw(mount)
    up = ANGLES[::-1][row]
    ray = [math.cos(up) * math.cos(azimuth), math.cos(up) * math.sin(azimuth), math.sin(up)]
    point = tiny_world.carried(mount, distance * np.array(ray))
    if poses is None:
        return point
    roll, pitch, yaw, *place = poses[row, column].astype(float)
    for axis, angle in (("x", roll), ("y", pitch), ("z", yaw)):
        point = Rotation.from_euler(axis, angle).apply(point)
    return tiny_world.carried(np.linalg.inv(tiny_world.world_from_sweep(index)), point + place)


IMAGES = [[made_image(index, laser) for laser in MOUNTS] for index in range(tiny_world.NUM_SWEEPS)]


def check(source):
    """Compares sweeps with the images and boxes they are made from."""
    assert source.frame_id == "vehicle"
    for index, sweep in enumerate(source.sweeps):
        assert sweep.stamp_ns == tiny_world.stamp_ns(index)
        points = [image.points for image in IMAGES[index]]
        np.testing.assert_allclose(sweep.xyz, np.vstack(points), atol=1e-4)
        np.testing.assert_allclose(sweep.pose, tiny_world.world_from_sweep(index), atol=1e-9)
        laser = sweep.columns["laser"]
        assert laser.tolist() == np.repeat([1, 2], list(map(len, points))).tolist()
        assert np.array_equal(sweep.columns["elongation"], 0.25 * laser)
        assert set(sweep.columns["intensity"]) == {0.5}
        assert sweep.labelled.all()
        boxes = {box.track_id: box for box in sweep.boxes}
        assert boxes.keys() == tiny_world.boxes(index).keys()
        for track, pose in tiny_world.boxes(index).items():
            np.testing.assert_allclose(boxes[track].pose, pose, atol=1e-9)
            assert boxes[track].size_m.tolist() == tiny_world.SIZE.tolist()
            assert boxes[track].class_id == tiny_world.CAR
    assert index == tiny_world.NUM_SWEEPS - 1


def write_split(folder, segment="one", **changes):
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    for name, rows in {**tables(), **changes}.items():
        path = folder / name / f"{segment}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pa.Table.from_pylist(rows), path, row_group_size=2)
    return folder


def tables():
    rows = {name: [] for name in ("lidar", "lidar_pose", "vehicle_pose", "lidar_box")}
    for index, images in enumerate(IMAGES):
        key = {"key.frame_timestamp_micros": tiny_world.stamp_ns(index) // 1000}
        pose = tiny_world.world_from_sweep(index).ravel()
        rows["vehicle_pose"].append({**key, VEHICLE: pose.tolist()})
        rows["lidar_box"] += [key | box_row(*item) for item in tiny_world.boxes(index).items()]
        for laser, one in zip(MOUNTS, images, strict=True):
            laser_key = {**key, "key.laser_name": laser}
            rows["lidar"].append(laser_key | columns("LiDARComponent", one.image))
            if one.poses is not None:
                rows["lidar_pose"].append(laser_key | columns("LiDARPoseComponent", one.poses))
    rows["lidar_calibration"] = [calibration_row(laser, ANGLES) for laser in MOUNTS]
    return rows


def columns(component, values):
    prefix = f"[{component}].range_image_return1"
    return {f"{prefix}.values": values.ravel(), f"{prefix}.shape": list(values.shape)}


def box_row(track, pose):
    row = {f"{BOX}.center.{axis}": place for axis, place in zip("xyz", pose[:3, 3], strict=True)}
    row |= {f"{BOX}.size.{axis}": side for axis, side in zip("xyz", tiny_world.SIZE, strict=True)}
    row |= {f"{BOX}.heading": tiny_world.yaw(pose), "[LiDARBoxComponent].type": 1}
    return {**row, "key.laser_object_id": track}


def calibration_row(laser, angles):
    prefix = "[LiDARCalibrationComponent]"
    return {
        "key.laser_name": laser,
        f"{prefix}.extrinsic.transform": MOUNTS[laser].ravel().tolist(),
        f"{prefix}.beam_inclination.min": -0.4,
        f"{prefix}.beam_inclination.max": 0.1,
        f"{prefix}.beam_inclination.values": angles,
    }


def test_parquet_files_become_sweeps(tmp_path):
    source = write_split(tmp_path)
    check(open_source("waymo", source))
    write_split(tmp_path, "two")
    check(open_source("waymo", source, sequence="two"))
    with pytest.raises(DatasetError, match="several segments, name one; it has one, two"):
        open_source("waymo", source)
    with pytest.raises(DatasetError, match="no segment 'three'; it has one, two"):
        open_source("waymo", source, sequence="three")


def with_first(table, **values):
    first, *others = tables()[table]
    return {table: [first | values, *others]}


ROWS = tables()
FEW_ANGLES = [calibration_row(laser, [0.1] * 3) for laser in MOUNTS]
FRAME = f"frame {tiny_world.stamp_ns(0) // 1000}: "


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lidar_pose": ROWS["lidar_pose"][:1]}, "has no pose in .*lidar_pose"),
        ({"vehicle_pose": [{"a": 1}]}, r"has no column .*\[VehiclePoseComponent\]"),
        ({"lidar_calibration": FEW_ANGLES}, "rows for 3 inclinations"),
        ({"lidar_calibration": ROWS["lidar_calibration"][:1]}, "cannot be read: it has no 2"),
        (with_first("lidar_box", **{f"{BOX}.size.x": None}), f"{FRAME}.*its size is"),
        (with_first("lidar_box", **{f"{BOX}.heading": math.nan}), f"{FRAME}.*no rigid motion"),
        (with_first("lidar_box", **{f"{BOX}.heading": None}), f"{FRAME}must be real number"),
        (with_first("vehicle_pose", **{VEHICLE: [0.0] * 16}), f"{FRAME}pose is no rigid motion"),
        (with_first("vehicle_pose", **{VEHICLE: [0.0] * 15}), f"{FRAME}cannot reshape"),
    ],
)
def test_parquet_files_that_do_not_fit_are_named(tmp_path, changes, message):
    source = write_split(tmp_path, **changes)
    with pytest.raises(DatasetError, match=rf"/one\.parquet: .*{message}"):
        list(open_source("waymo", source).sweeps)
    tiny_world.check_refused("waymo", write_split(tmp_path), "lidar/one.parquet", 999, "cannot be")


def test_evenly_spread_rows_and_zones_without_labels(tmp_path):
    image, key = np.full((2, 4, 4), -1, np.float32), {"key.frame_timestamp_micros": 5}
    image[:, :, 0], image[1, :, 3] = 10, 1
    level = calibration_row(1, None)
    level["[LiDARCalibrationComponent].beam_inclination.min"] = -0.2
    level["[LiDARCalibrationComponent].beam_inclination.max"] = 0.2
    level["[LiDARCalibrationComponent].extrinsic.transform"] = np.eye(4).ravel().tolist()
    # A frame without returns is an empty sweep.
    keys = [{**key, "key.laser_name": 1}, {"key.frame_timestamp_micros": 6, "key.laser_name": 1}]
    source = write_split(
        tmp_path,
        lidar=[
            one | columns("LiDARComponent", values)
            for one, values in zip(keys, (image, np.zeros_like(image)), strict=True)
        ],
        lidar_pose=[one | columns("LiDARPoseComponent", np.zeros((2, 4, 6))) for one in keys],
        lidar_calibration=[level],
        vehicle_pose=[
            {"key.frame_timestamp_micros": micros, VEHICLE: np.eye(4).ravel().tolist()}
            for micros in (5, 6)
        ],
    )
    sweep, empty = open_source("waymo", source).sweeps
    assert len(empty) == 0
    assert sweep.labelled.tolist() == [True] * 4 + [False] * 4
    for row, column in itertools.product(range(2), range(4)):
        x, y, z = sweep.xyz[4 * row + column]
        # The upper half of the angles comes first, and columns go clockwise from the back.
        assert math.asin(z / 10) == pytest.approx((0.1, -0.1)[row], abs=1e-6)
        assert math.degrees(math.atan2(y, x)) == pytest.approx(135 - 90 * column, abs=1e-4)
