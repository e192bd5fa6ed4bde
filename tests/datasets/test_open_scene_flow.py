# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import tiny_world

from mnsf_ros.datasets.conversion import open_source
from mnsf_ros.errors import DatasetError

h5py = pytest.importorskip("h5py")


def write_sequence(path, *, unit_ns=1):
    with h5py.File(path, "w") as file:
        # Not in the order of time.
        for index in (2, 0, 1):
            stamp = tiny_world.stamp_ns(index)
            group = file.create_group(str(stamp // unit_ns))
            write_group(group, index)
    return path


def write_group(group, index):
    tiny = tiny_world.sweep(index)
    group["lidar"] = np.column_stack([tiny.xyz, np.full(len(tiny.xyz), 5)]).astype(np.float32)
    group["lidar_dt"] = np.full(len(tiny.xyz), 0.01, np.float32)
    group["pose"] = tiny_world.world_from_sweep(index).astype(np.float32)
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
    return tiny_world.convert("opensceneflow", source, out)


# Argoverse 2; ZOD; nuScenes, Waymo and TruckScenes.
@pytest.mark.parametrize("unit_ns", [1, 100, 1000])
def test_a_sequence_becomes_a_recording_with_truth(tmp_path, unit_ns):
    path = write_sequence(tmp_path / "log.h5", unit_ns=unit_ns)
    assert open_source("opensceneflow", path).note == ""
    found = tiny_world.check_recording(convert(path, tmp_path / "out"), "lidar")
    for truth in found.truth:
        assert np.array_equal(truth.ground, np.arange(len(truth)) % 3 == 0)
    assert set(found.columns[0]["intensity"]) == {5}
    assert set(found.columns[0]["time_offset"]) == {np.float32(0.01)}


@pytest.mark.parametrize(
    ("first", "step", "unit_ns"),
    [(0, 100_000_000, 1), (0, 1_000_000, 100), (0, 50_000, 1000), (1_666 * 10**13, 500_000, 100)],
)
def test_unit_of_stamps_is_told_by_digits_and_intervals(tmp_path, first, step, unit_ns):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for index in range(3):
            group = file.create_group(str(first + index * step))
            group["lidar"] = tiny_world.sweep(0).xyz.astype(np.float32)
    sweeps = open_source("opensceneflow", tmp_path / "log.h5").sweeps
    stamps = [(first + index * step) * unit_ns for index in range(3)]
    assert [sweep.stamp_ns for sweep in sweeps] == stamps


def test_points_may_be_in_the_frame_of_the_lidar_and_poses_in_that_of_the_vehicle(tmp_path):
    """As the extractor of Argoverse 2 writes them (OpenSceneFlow 848bf86)."""
    path, mount = write_sequence(tmp_path / "log.h5"), np.array([1.35, -0.2, 1.64])
    with h5py.File(path, "a") as file:
        for group in file.values():
            group["lidar"][:, :3] -= mount
    assert "their origin is at 1.35, -0.2 m" in open_source("opensceneflow", path).note
    found = tiny_world.read(convert(path, tmp_path / "out"))
    for index, (pose, truth) in enumerate(zip(found.poses.values(), found.truth, strict=True)):
        expected = tiny_world.world_from_sweep(index)
        expected[:2, 3] += expected[:2, :2] @ mount[:2]
        np.testing.assert_allclose(pose, expected, atol=2e-4)
        static = tiny_world.sweep(index).part == tiny_world.STATIC
        assert not (truth.dynamic & static).any()


def test_poses_that_contradict_the_flow_are_told(tmp_path):
    path = write_sequence(tmp_path / "log.h5")
    with h5py.File(path, "a") as file:
        file[f"{tiny_world.stamp_ns(1)}/pose"][2, 3] += 0.3
    assert "contradicts 'pose' by up to 0.30 m and" in open_source("opensceneflow", path).note


def remove(path, *names):
    with h5py.File(path, "a") as file:
        for name in names:
            del file[name]
    return path


def test_a_sweep_without_flow_has_its_pose(tmp_path):
    path = remove(write_sequence(tmp_path / "log.h5"), f"{tiny_world.stamp_ns(1)}/flow")
    found = tiny_world.read(convert(path, tmp_path / "out"))
    assert list(found.poses) == found.stamps
    assert [truth.valid.any() for truth in found.truth] == [True, False, False]


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("lidar", np.zeros((50, 2), np.float32), r"xyz has shape \(50, 2\), expected \(N, 3\)"),
        ("lidar", np.zeros((50, 3), np.complex64), "holds complex numbers"),
        ("lidar", ["a", "b"], "could not convert string to float"),
        ("lidar", h5py.Empty("<f4"), ""),
        ("lidar", h5py.ExternalLink("nowhere", "/data"), "can't open file"),
        ("flow", np.zeros((7, 3), np.float32), r"flow has shape \(7, 3\), expected"),
        ("flow", np.full((7, 3), 1e300), "overflow encountered in cast"),
        ("pose", np.zeros((4, 4)), "pose is no rigid motion"),
        ("ground_mask", np.zeros(7, bool), r"ground has shape \(7,\), expected"),
        ("flow_category_indices", np.zeros(7, np.uint8), r"class_id has shape \(7,\), expected"),
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


@pytest.mark.parametrize("kind", ["external", "virtual", "group"])
def test_values_of_other_files_are_not_read(tmp_path, kind):
    """HDF5 would read any file on the machine."""
    other, key = tmp_path / "other", str(tiny_world.stamp_ns(0))
    with h5py.File(other, "w") as file:
        file["data"] = np.ones((4, 3), np.float32)
    with h5py.File(tmp_path / "log.h5", "w") as file:
        if kind == "group":
            file[key] = h5py.ExternalLink(str(other), "/")
        elif kind == "external":
            file.create_dataset(f"{key}/lidar", (4, 3), "<f4", external=[(str(other), 0, 48)])
        else:
            layout = h5py.VirtualLayout((4, 3), "<f4")
            layout[...] = h5py.VirtualSource(str(other), "data", (4, 3))
            file.create_group(key).create_virtual_dataset("lidar", layout)
    with pytest.raises(DatasetError, match="in another file"):
        convert(tmp_path / "log.h5", tmp_path / "out")


@pytest.mark.parametrize("length", [0, 100, 9000])
def test_cut_files_are_named(tmp_path, length):
    path = write_sequence(tmp_path / "log.h5")
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(DatasetError, match=r"log\.h5: cannot be read"):
        convert(path, tmp_path / "out")


@pytest.mark.parametrize("name", ["", "points", "²", "9" * 20, "9" * 5000], ids=len)
def test_names_that_are_no_stamps_are_refused(tmp_path, name):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        if name:
            file.create_group(name)
    found = f"group '{name}'" if name else "no group"
    with pytest.raises(DatasetError, match=f"has {found}, expected one named by the stamp"):
        convert(tmp_path / "log.h5", tmp_path / "out")
