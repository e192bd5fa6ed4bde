# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.pseudo_ground_truth import TruthSettings

EARTH_RADIUS_M = 6_378_137.0
LATITUDE, LONGITUDE = 49.0, 8.4
# Lidar in the IMU frame: ahead, to the left and above, and turned a little.
LIDAR_FROM_IMU = tiny_world.pose(-0.8, 0.3, -0.8, 0.01)
# Looks to the front, with x to the right and y down, 0.1 m behind the lidar.
CAMERA_FROM_LIDAR = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0.1], [0, 0, 0, 1.0]])
FOCAL, WIDTH, HEIGHT = 100.0, 200.0, 80.0


def write_drive(folder, *, tracklets=True):
    """A drive in the layout of the synchronized data, with the sweep of number 1 lost."""
    drive = folder / "2011_09_26" / "2011_09_26_drive_0005_sync"
    for sub in ("velodyne_points/data", "oxts/data"):
        (drive / sub).mkdir(parents=True)
    lines = []
    for number in range(4):
        index = max(number - 1, 0)
        stamp = np.datetime64(tiny_world.stamp_ns(index), "ns")
        lines.append("" if number == 1 else str(stamp).replace("T", " "))
        write_imu(drive / f"oxts/data/{number:010d}.txt", index)
        if number != 1:
            xyz = tiny_world.sweep(index).xyz
            rows = np.column_stack([xyz, np.full(len(xyz), 0.25)]).astype("<f4")
            rows.tofile(drive / f"velodyne_points/data/{number:010d}.bin")
    (drive / "velodyne_points/timestamps.txt").write_text("\n".join(lines) + "\n")
    write_calibration(drive.parent)
    if tracklets:
        (drive / "tracklet_labels.xml").write_text(tracklet_text())
    return drive


def write_imu(path, index):
    pose = tiny_world.world_from_sweep(index) @ LIDAR_FROM_IMU
    x, y, z = (pose[:3, 3] - LIDAR_FROM_IMU[:3, 3]).tolist()
    scale = EARTH_RADIUS_M * math.cos(math.radians(LATITUDE))
    longitude = LONGITUDE + math.degrees(x / scale)
    mercator = math.asinh(math.tan(math.radians(LATITUDE))) + y / scale
    latitude = math.degrees(math.atan(math.sinh(mercator)))
    numbers = [float(latitude), float(longitude), 100 + z, 0, 0, tiny_world.yaw(pose)]
    path.write_text(" ".join(map(repr, numbers)) + " 0" * 24)


def write_calibration(folder):
    def entry(name, values):
        return f"{name}: {' '.join(repr(float(v)) for v in np.ravel(values))}\n"

    def rigid(transform):
        return entry("R", transform[:3, :3]) + entry("T", transform[:3, 3])

    date = "calib_time: 15-Mar-2012 11:37:16\n"
    (folder / "calib_imu_to_velo.txt").write_text(date + rigid(LIDAR_FROM_IMU))
    (folder / "calib_velo_to_cam.txt").write_text(date + rigid(CAMERA_FROM_LIDAR))
    projection = [[FOCAL, 0, WIDTH / 2, 0], [0, FOCAL, HEIGHT / 2, 0], [0, 0, 1, 0]]
    (folder / "calib_cam_to_cam.txt").write_text(
        date
        + entry("R_rect_00", np.eye(3))
        + entry("S_rect_02", [WIDTH, HEIGHT])
        + entry("P_rect_02", projection)
    )


def tracklet_text():
    items = ""
    length, width, height = tiny_world.SIZE
    for track in ("mover", "parked", "gone"):
        poses = ""
        for number in range(1 if track == "gone" else 4):
            box = tiny_world.boxes(max(number - 1, 0))[track]
            x, y, z = box[:3, 3].tolist()
            yaw = tiny_world.yaw(box)
            poses += (
                f"<item><tx>{x!r}</tx><ty>{y!r}</ty><tz>{float(z - height / 2)!r}</tz>"
                f"<rx>0</rx><ry>0</ry><rz>{yaw!r}</rz><state>2</state></item>"
            )
        items += (
            f"<item><objectType>Van</objectType><h>{height}</h><w>{width}</w><l>{length}</l>"
            f"<first_frame>0</first_frame><poses><count>9</count>{poses}</poses></item>"
        )
    return (
        f"<boost_serialization><tracklets><count>3</count>{items}</tracklets></boost_serialization>"
    )


def convert(drive, out, **settings):
    return tiny_world.convert("kitti", drive, out, TruthSettings(**settings))


def test_a_drive_becomes_a_recording_with_truth(tmp_path):
    out = convert(write_drive(tmp_path), tmp_path / "out", unlabelled_static=True)
    found = tiny_world.check_recording(out, "velodyne", tolerance=1e-4)
    assert (found.columns[0]["intensity"] == 0.25).all()


def test_only_what_the_camera_sees_and_boxes_are_valid(tmp_path):
    found = tiny_world.read(convert(write_drive(tmp_path), tmp_path / "out"))
    tiny = tiny_world.sweep(0)
    x, y, z = tiny.xyz.astype(float).T
    depth = x + 0.1
    u, v = WIDTH / 2 - FOCAL * y / depth, HEIGHT / 2 - FOCAL * z / depth
    seen = (depth > 0) & (u >= 0) & (u < WIDTH) & (v >= 0) & (v < HEIGHT)
    boxed = np.isin(tiny.part, (tiny_world.MOVER, tiny_world.MARGIN, tiny_world.PARKED))
    assert 0.1 < seen.mean() < 0.5
    expected = (seen & (tiny.part != tiny_world.GONE)) | boxed
    # Ground in a box is labelled, too, but the test does not know which points these are.
    assert (found.truth[0].valid >= expected).all()
    assert (found.truth[0].valid != expected).mean() < 0.05


def test_without_tracklets_nothing_is_valid(tmp_path):
    drive = write_drive(tmp_path, tracklets=False)
    # The calibration may lie in the drive, too.
    for file in drive.parent.glob("calib_*.txt"):
        file.rename(drive / file.name)
    assert not tiny_world.read(convert(drive, tmp_path / "out")).truth[0].valid.any()
    found = tiny_world.read(convert(drive, tmp_path / "all", unlabelled_static=True))
    assert found.truth[0].valid.all()
    assert not found.truth[0].dynamic.any()


def test_points_that_are_not_finite_stay_without_valid_flow(tmp_path):
    drive = write_drive(tmp_path)
    path = drive / "velodyne_points/data/0000000002.bin"
    rows = np.fromfile(path, "<f4").reshape(-1, 4)
    rows[:9] = np.nan
    rows[9:18] = -np.inf
    rows.tofile(path)
    found = tiny_world.read(convert(drive, tmp_path / "out", unlabelled_static=True))
    assert len(found.columns[1]) == len(rows)
    assert not found.truth[1].valid[:18].any()
    assert found.truth[1].valid[18:].any()


POINTS = "velodyne_points/data/0000000002.bin"
STAMPS = "velodyne_points/timestamps.txt"
TRACKLETS = "tracklet_labels.xml"
SCALED = b"R: 2 0 0 0 2 0 0 0 2\nT: 0 0 0"


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        (POINTS, b"x" * 1001, "is cut short: 1001 bytes"),
        (POINTS, b"", "is cut short: 0 bytes"),
        (POINTS, b"~" * 160, "a point has the coordinate 8"),
        ("oxts/data/0000000002.txt", b"nan " * 30, r"begins with \[nan, .*6 finite numbers"),
        ("oxts/data/0000000002.txt", None, "no such file"),
        ("oxts/data/0000000003.txt", b"1 2 3", "expected 6 finite numbers"),
        (STAMPS, None, "no such file"),
        (STAMPS, b"2011\n", "line 3: list index out of range"),
        (STAMPS, b"x\n" * 9, "line 1: Error parsing datetime"),
        (TRACKLETS, b"<a><b>", "no element found"),
        (TRACKLETS, b"<a/>", "has no element 'tracklets'"),
        (TRACKLETS, (b"<l>", b"<l>-"), r"its size is \[-4"),
        (TRACKLETS, (b"<tx>", b"<tx>nan</tx><tx>"), "no rigid"),
        (TRACKLETS, (b"ty>", b"tyy>"), "it has no 'ty'"),
        ("../calib_imu_to_velo.txt", None, "no such file"),
        ("../calib_imu_to_velo.txt", SCALED, "pose is no rigid motion"),
        ("../calib_cam_to_cam.txt", b"K_00: 1", "it has no 'R_rect_00'"),
        ("../calib_velo_to_cam.txt", b"R: 1 2\nT: 0 0 0", "cannot reshape"),
    ],
)
def test_damage_is_named(tmp_path, file, change, message):
    tiny_world.check_refused("kitti", write_drive(tmp_path), file, change, message)
