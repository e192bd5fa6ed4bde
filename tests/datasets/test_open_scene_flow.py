# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import zlib

import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.formats import open_source
from mnsf_ros.datasets.recording_writer import write_recording
from mnsf_ros.decompression import MAX_BYTES
from mnsf_ros.errors import DatasetError

h5py = pytest.importorskip("h5py")
# From the lidar to the vehicle, whose poses the files have beside points of the lidar.
VEHICLE_FROM_LIDAR = tiny_world.pose(1.5, 0, 1.7, 0)


def write_sequence(path, *, microseconds=False, vehicle_from_lidar=VEHICLE_FROM_LIDAR):
    with h5py.File(path, "w") as file:
        # Not in the order of time.
        for index in (2, 0, 1):
            stamp = tiny_world.stamp_ns(index)
            group = file.create_group(str(stamp // 1000 if microseconds else stamp))
            write_group(group, index, vehicle_from_lidar)
    return path


def write_group(group, index, vehicle_from_lidar):
    tiny = tiny_world.sweep(index)
    pose = tiny_world.world_from_sweep(index) @ np.linalg.inv(vehicle_from_lidar)
    group["lidar"] = np.column_stack([tiny.xyz, np.full(len(tiny.xyz), 5)]).astype(np.float32)
    group["lidar_dt"] = np.full(len(tiny.xyz), 0.01, np.float32)
    group["pose"] = pose.astype(np.float32)
    group["ground_mask"] = np.arange(len(tiny.xyz)) % 3 == 0
    if index < tiny_world.NUM_SWEEPS - 1:
        on_car = np.isin(tiny.part, (1, 2, 4, 5))
        flow = tiny_world.expected_flow(index, tiny.xyz, tiny.part)
        group["flow"] = flow.astype(np.float32)
        group["flow_is_valid"] = tiny.part != tiny_world.GONE
        group["flow_category_indices"] = np.where(on_car, 19, 0).astype(np.uint8)
        group["flow_instance_id"] = np.zeros(len(tiny.xyz), np.int16)
        group["ego_motion"] = np.eye(4, dtype=np.float32)


def convert(source, out):
    write_recording(open_source("opensceneflow", source), out)
    return out


@pytest.mark.parametrize("microseconds", [False, True])
def test_a_sequence_becomes_a_recording_with_truth(tmp_path, microseconds):
    path = write_sequence(tmp_path / "log.h5", microseconds=microseconds)
    found = tiny_world.read(convert(path, tmp_path / "out"))
    assert found.stamps == [tiny_world.stamp_ns(index) for index in range(3)]
    assert found.frames == {"lidar"}
    for index in range(tiny_world.NUM_SWEEPS):
        tiny = tiny_world.sweep(index)
        assert np.array_equal(found.xyz[index], tiny.xyz)
        assert np.array_equal(found.truth[index].ground, np.arange(len(tiny.xyz)) % 3 == 0)
        if index < 2:
            tiny_world.check_truth(found.truth[index], index, tiny.xyz, tiny.part)
    assert not found.truth[2].valid.any()
    assert set(found.columns[0]["intensity"]) == {5}
    assert set(found.columns[0]["time_offset"]) == {np.float32(0.01)}
    check_poses(found)


def check_poses(found, num_sweeps=tiny_world.NUM_SWEEPS):
    """The odometry is that of the points, in the frame of the first sweep."""
    assert list(found.poses) == found.stamps[:num_sweeps]
    for index, stamp in enumerate(found.poses):
        pose = tiny_world.world_from_sweep(0) @ found.poses[stamp]
        np.testing.assert_allclose(pose, tiny_world.world_from_sweep(index), atol=1e-5)


def remove(path, *names):
    with h5py.File(path, "a") as file:
        for name in names:
            del file[name]
    return path


def test_poses_end_where_neither_flow_nor_the_file_tells_them(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    remove(path, f"{tiny_world.stamp_ns(1)}/flow")
    check_poses(tiny_world.read(convert(path, tmp_path / "out")), num_sweeps=2)
    remove(path, f"{tiny_world.stamp_ns(0)}/flow")
    check_poses(tiny_world.read(convert(path, tmp_path / "none")), num_sweeps=1)


def test_poses_of_the_file_that_agreed_with_flow_fill_its_gaps(tmp_path):
    path = write_sequence(tmp_path / "log.h5", vehicle_from_lidar=np.eye(4))
    remove(path, f"{tiny_world.stamp_ns(1)}/flow")
    check_poses(tiny_world.read(convert(path, tmp_path / "out")))


def test_flow_of_a_few_standing_points_tells_no_pose(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    with h5py.File(path, "a") as file:
        categories = file[f"{tiny_world.stamp_ns(0)}/flow_category_indices"]
        categories[...] = np.where(np.arange(len(categories)) < 99, 0, 19)
    check_poses(tiny_world.read(convert(path, tmp_path / "out")), num_sweeps=1)


def test_sweeps_without_flow_are_not_valid(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    remove(path, f"{tiny_world.stamp_ns(1)}/flow")
    found = tiny_world.read(convert(path, tmp_path / "out"))
    assert [truth.valid.any() for truth in found.truth] == [True, False, False]


def test_damage_is_named_and_nothing_is_left_behind(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    whole = path.read_bytes()
    for keep in (0, 100, len(whole) // 2):
        path.write_bytes(whole[:keep])
        with pytest.raises(DatasetError, match=r"log\.h5: cannot be read"):
            convert(path, tmp_path / "out" / "bag")
    path.write_bytes(whole)
    with h5py.File(path, "a") as file:
        del file[f"{tiny_world.stamp_ns(1)}/pose"]
    with pytest.raises(DatasetError, match=r"log\.h5: cannot be read: .*pose"):
        convert(path, tmp_path / "out" / "bag")
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("lidar", np.zeros((50, 2), np.float32), r"xyz has shape \(50, 2\), expected \(N, 3\)"),
        (
            "lidar",
            np.zeros((50, 3), np.complex64),
            r"it holds complex64 of shape \(50, 3\), expected real",
        ),
        ("flow", np.zeros((7, 3), np.float32), r"flow has shape \(7, 3\), expected"),
        ("flow", np.full((7, 3), 1e300), "overflow encountered in cast"),
        ("ground_mask", np.zeros(7, bool), r"ground has shape \(7,\), expected"),
        ("flow_category_indices", np.zeros(7, np.uint8), r"class_id has shape \(7,\), expected"),
        ("pose", np.diag([2.0, 2, 2, 1]), "pose is no rigid motion"),
        ("pose", np.zeros((4, 4)), "pose is no rigid motion"),
        ("pose", None, "has no data set pose; it has ego_motion, flow, "),
        ("flow_is_valid", None, "has no data set flow_is_valid; it has ego_motion, flow, "),
    ],
)
def test_what_does_not_fit_is_named_with_file_and_sweep(tmp_path, name, values, message):
    group = str(tiny_world.stamp_ns(1))
    path = remove(write_sequence(tmp_path / "log.h5"), f"{group}/{name}")
    if values is not None:
        with h5py.File(path, "a") as file:
            file[f"{group}/{name}"] = values
    with pytest.raises(
        DatasetError, match=rf"log\.h5: cannot be read: group '{group}': .*{message}"
    ):
        convert(path, tmp_path / "out")


def test_other_files_are_refused(tmp_path):
    with pytest.raises(DatasetError, match="nowhere: no such file"):
        open_source("opensceneflow", tmp_path / "nowhere")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["points"] = [1]
    with pytest.raises(DatasetError, match="has group 'points', expected one named by the stamp"):
        open_source("opensceneflow", tmp_path / "other.h5")
    with h5py.File(tmp_path / "empty.h5", "w"):
        pass
    with pytest.raises(DatasetError, match="has no group"):
        open_source("opensceneflow", tmp_path / "empty.h5")


def test_data_set_beyond_the_limit_is_refused_before_it_is_read(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    with h5py.File(path, "a") as file:
        group = file[str(tiny_world.stamp_ns(1))]
        del group["lidar"]
        # Chunks that were never written take no room in the file.
        group.create_dataset("lidar", (10**8, 4), np.float32, chunks=(1000, 4))
    message = r"log\.h5.*group.*data set 'lidar': it has 1600000000 bytes, the limit is 268435456"
    with pytest.raises(DatasetError, match=message):
        convert(path, tmp_path / "out")


def write_external(group, other):
    group.create_dataset("lidar", (4, 3), "<f4", external=[(str(other), 0, 48)])


def write_virtual(group, other):
    layout = h5py.VirtualLayout((4, 3), "<f4")
    layout[...] = h5py.VirtualSource(str(other), "data", (4, 3))
    group.create_virtual_dataset("lidar", layout)


def write_external_link(group, other):
    group["lidar"] = h5py.ExternalLink(str(other), "/data")


def write_soft_link(group, _):
    group["lidar"] = h5py.SoftLink("pose")


def write_lists(group, _):
    group.create_dataset("lidar", (4,), h5py.vlen_dtype(np.float32))


def write_texts(group, _):
    group["lidar"] = ["a", "b"]


def write_nothing(group, _):
    group["lidar"] = h5py.Empty("<f4")


def write_subgroup(group, _):
    group.create_group("lidar")


def write_bomb(group, _):
    data = group.create_dataset("lidar", (4, 3), "<f4", chunks=(4, 3), compression="gzip")
    data.id.write_direct_chunk((0, 0), zlib.compress(bytes(10**6)))


def write_large_chunk(group, _):
    rows = MAX_BYTES // 12 + 1
    group.create_dataset(
        "lidar", (4, 3), "<f4", chunks=(rows, 3), maxshape=(None, 3), compression="gzip"
    ).id.write_direct_chunk((0, 0), zlib.compress(bytes(48)))


def write_other_filter(group, _):
    group.create_dataset("lidar", data=np.zeros((4, 3), "<f4"), compression="lzf")


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (write_external, "data set 'lidar': its values are in '.*other', expected them in the"),
        (write_virtual, "data set 'lidar': its values are in other data sets, expected them in"),
        (write_external_link, "'lidar' is a link to another place, expected it in the file"),
        (write_soft_link, "'lidar' is a link to another place, expected it in the file"),
        (write_lists, r"data set 'lidar': it holds object of shape \(4,\), expected real"),
        (write_texts, r"data set 'lidar': it holds object of shape \(2,\), expected real"),
        (write_nothing, "data set 'lidar': it holds float32 of shape None, expected real"),
        (write_subgroup, "'lidar' is a Group, expected a Dataset"),
        (write_bomb, "data set 'lidar': .* zlib data expand to more than 48 bytes"),
        (write_large_chunk, f"data set 'lidar': all chunks .*, the limit is {MAX_BYTES} bytes"),
        (write_other_filter, r"data set 'lidar': it has the filters \[32000\], expected none, or"),
    ],
)
def test_only_limited_arrays_of_the_file_itself_are_read(tmp_path, write, message):
    other = tmp_path / "other"
    with h5py.File(other, "w") as file:
        file["data"] = np.ones((4, 3), np.float32)
    key = str(tiny_world.stamp_ns(0))
    with h5py.File(tmp_path / "log.h5", "w") as file:
        group = file.create_group(key)
        write(group, other)
        group["pose"] = np.eye(4)
    where = rf"log\.h5: cannot be read: group '{key}': "
    with pytest.raises(DatasetError, match=where + message):
        convert(tmp_path / "log.h5", tmp_path / "out")


@pytest.mark.parametrize("name", ["flow", "ground_mask", "pose"])
def test_each_data_set_is_the_file_s_own(tmp_path, name):
    group = str(tiny_world.stamp_ns(1))
    path = remove(write_sequence(tmp_path / "log.h5"), f"{group}/{name}")
    with h5py.File(path, "a") as file:
        file[f"{group}/{name}"] = h5py.ExternalLink(str(path), "/nowhere")
    with pytest.raises(DatasetError, match=f"{name}' is a link to another place"):
        convert(path, tmp_path / "out")


def test_a_group_in_another_file_is_refused(tmp_path):
    other = write_sequence(tmp_path / "other.h5")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["1700000000000000000"] = h5py.ExternalLink(str(other), f"/{tiny_world.stamp_ns(0)}")
    with pytest.raises(DatasetError, match="'1700000000000000000' is a link to another place"):
        convert(tmp_path / "log.h5", tmp_path / "out")


@pytest.mark.parametrize("name", ["²", "9" * 20, "9" * 5000], ids=["power", "20", "5000"])
def test_names_that_are_no_stamps_are_refused(tmp_path, name):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_group(name)
    with pytest.raises(DatasetError, match=f"has group '{name}', expected one named by the stamp"):
        convert(tmp_path / "log.h5", tmp_path / "out")


def test_compressed_data_sets_are_read(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    xyz = tiny_world.sweep(0).xyz
    how = {"chunks": (3, 2), "compression": "gzip", "shuffle": True, "fletcher32": True}
    with h5py.File(path, "a") as file:
        group = file[str(tiny_world.stamp_ns(0))]
        del group["lidar"], group["lidar_dt"]
        group.create_dataset("lidar", data=xyz, **how)
        shape = (len(xyz),)
        times = group.create_dataset("lidar_dt", shape, "<f4", chunks=shape, compression="gzip")
        # One chunk, stored as it is.
        as_it_is = np.full(shape, 0.01, "<f4").tobytes()
        times.id.write_direct_chunk((0,), as_it_is, filter_mask=1)
    found = tiny_world.read(convert(path, tmp_path / "out"))
    assert np.array_equal(found.xyz[0], xyz)
    assert set(found.columns[0]["time_offset"]) == {np.float32(0.01)}
